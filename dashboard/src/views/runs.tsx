/** Jobs of a kind, listed, filtered, followed, deleted with undo; runs among them, variants beneath the run they vary. */
import type { ComponentChildren } from "preact";
import { useEffect, useRef, useState, useCallback } from "preact/hooks";
import { api, problemOf, type Collection, follow, goesOn, type Standing } from "../api/client";
import type { JobSummary, Page, Problem, RunSummary } from "../api/types";
import { chosen, DeleteButton, type Filter, FilterBar, type Row, Rows, unusual, useFilter } from "../components/list";
import {
  Badge,
  Busy,
  Button,
  Empty,
  MeasureLink,
  Name,
  ProblemNote,
  State,
  NameLink,
  Title,
  Toggle,
} from "../components/basics";
import { Select } from "../components/fields";
import { Bar } from "../components/job_page";
import { percent } from "../lib/format";
import { groupedBy } from "../lib/json";
import { whenSeen, type Names, useNames, valueOf } from "../state/load";
import { link, toast, go } from "../state/action";
import { text } from "../i18n";
import { waysOf } from "./run_context";

const words = text.list;
/** A browser keeps six connections to a host; those that are followed must leave some for the rest of the page. */
const FOLLOWED = 3;
const PAGE = 100;

type Summary<Of extends Collection> = Awaited<ReturnType<(typeof api)[Of]["list"]>>["items"][number];
type About = Pick<Row, "name"> & Partial<Row>;

/** What jobs of each kind are about. */
const ABOUT: { [Of in Collection]: (item: Summary<Of>, names: Names | null) => About } = {
  runs: aboutRun,
  comparisons: ({ measurement_set_id: first, second_set_id: second }, names) => ({
    name: [first, second].flatMap((id) => (id ? [names?.set(id) ?? "…"] : [])).join(" → "),
  }),
  fleets: ({ name }) => ({ name: name ?? text.earlier.fleet }),
  geometries: ({ name }) => ({ name: name ?? "…" }),
  plans: ({ measurement_set_id: set, robot_id: robot }, names) => ({
    name: (set ? names?.set(set) : robot && names?.robot(robot)) || "…",
  }),
  maps: ({ name }) => ({ name: name ?? text.run.views.map }),
  programs: ({ name }) => ({ name: name ?? text.run.views.program }),
};

/** A job as a row. */
function rowOf<Of extends Collection>(collection: Of, item: Summary<Of>, names: Names | null, live = true): Row {
  const job = item as JobSummary;
  const robot = job.robot_id === null ? "" : (names?.robot(job.robot_id) ?? "…");
  const about: About = ABOUT[collection](item, names);
  return {
    id: job.id,
    href: link(collection === "comparisons" ? ["compare", "methods", job.id] : [collection, job.id]),
    note: robot && <Name>{robot}</Name>,
    figures: job.verdict && job.joint_count && <Figures of={job} />,
    at: job.created_at,
    standing: (
      <>
        <JobStanding job={job} live={live} />
      </>
    ),
    robot: job.robot_id,
    verdict: job.verdict,
    ...about,
    words: [robot, text.states[job.state], ...(about.words ?? [])],
  };
}

interface ListProps<Of extends Collection> {
  collection: Of;
  /** Which jobs are listed at all. */
  about?: Record<string, string>;
  query?: URLSearchParams;
  /** Hear the search as parameters of an address, to be shared. */
  address?: (query: Record<string, string>) => void;
  /** What picks a job, before its row. */
  pick?: (item: Summary<Of>, name: string) => ComponentChildren;
  /** Runs under headings of their sets. */
  grouped?: boolean;
  /** Beside the filters. */
  children?: ComponentChildren;
}

export function JobList<Of extends Collection>(props: ListProps<Of>) {
  const { collection, about = {}, query, address, pick, grouped = false, children } = props;
  const title = (text.earlier as Partial<Record<Collection, string>>)[collection]; // of runs it is the page's
  const names = valueOf(useNames());
  const [filter, change] = useFilter(query);
  const { state, robot, verdict } = filter;
  const deleted = state === "deleted";
  const { items, more, problem, load, take } = usePages(collection, {
    ...about,
    ...(deleted ? { deleted: "true" } : state === "all" ? {} : { state }),
    ...(robot && { robot_id: robot }),
    ...(verdict && { verdict }),
  });
  useEffect(() => address?.(unusual(filter)), [filter, address]);

  const failed = (error: unknown) => toast(problemOf(error).detail);
  const restore = (item: Summary<Of>) =>
    void api.jobs.restore(item.id).then(() => {
      load();
      toast(words.restored);
    }, failed);
  const remove = (item: Summary<Of>, name: string) =>
    void api.jobs.delete(item.id).then(() => {
      take(item.id);
      toast(text.deletion.done(name), { label: text.runs.undo, run: () => restore(item) });
    }, failed);
  const live = new Set((items ?? []).filter(({ state }) => goesOn(state)).slice(0, FOLLOWED));
  const rows = (items ?? []).map((item): Row => {
    const row = rowOf(collection, item, names, live.has(item));
    if (deleted) {
      const actions = (
        <Button onClick={() => restore(item)} acts>
          {text.lists.restore}
        </Button>
      );
      return { ...row, href: undefined, actions };
    }
    const actions = !goesOn(item.state) && <DeleteButton name={row.name} remove={() => remove(item, row.name)} />;
    return { ...row, actions, pick: pick?.(item, row.name) };
  });
  const found = chosen(rows, filter);
  const plain = state === "all" && robot === "" && verdict === "";
  const runs = collection === "runs" ? (items as RunSummary[] | null) : null;
  const sets = new Map(grouped ? runs?.map((run) => [run.id, run.measurement_set_id]) : []);
  const groups = groupedBy(runs ? nested(found, runs) : found, ({ id }) => sets.get(id));
  const nothing = deleted ? (
    <Empty title={words.noneDeleted} hint={words.deletedHint} />
  ) : items?.length === 0 && plain ? (
    <Empty title={words.none} hint={collection === "runs" ? words.noneHint : words.noneAbove}>
      {collection === "runs" && <MeasureLink />}
    </Empty>
  ) : (
    <Empty title={words.noMatch} hint={words.noMatchHint}>
      <Button onClick={() => change({ q: "", robot: "", verdict: "" })}>{text.runs.clear}</Button>
    </Empty>
  );
  return (
    <section class="list">
      {title && <h2>{title}</h2>}
      <FilterBar filter={filter} change={change} names={"robot_id" in about ? null : names} judged>
        <Select
          label={text.runs.state}
          value={state}
          change={(chosen) => change({ state: chosen as Filter["state"] })}
          options={{ all: text.app.all, ...text.states, deleted: words.deletedState }}
        />
        {children}
      </FilterBar>
      {deleted && <p class="soft">{words.deletedHint}</p>}
      {problem && <ProblemNote problem={problem} retry={load} />}
      {items === null && !problem && <Busy />}
      {items && items.length > 0 && (
        <p class="soft" role="status">
          {words.count(found.length, items.length)}
        </p>
      )}
      {[...groups].map(([set, members]) => (
        <section>
          {set !== undefined && (
            <h2 class="group">
              <NameLink to={["sets", set]}>{names?.set(set) ?? set}</NameLink>
            </h2>
          )}
          <Rows rows={members} />
        </section>
      ))}
      {items && found.length === 0 && nothing}
      {more && <Button onClick={more}>{text.app.more}</Button>}
    </section>
  );
}

/** Verdict, or state and progress, live while the job goes on and is followed. */
function JobStanding({ job, live }: { job: JobSummary; live: boolean }) {
  const [standing, set] = useState<Standing>({ id: job.id, state: job.state, progress: null });
  useEffect(() => {
    set({ id: job.id, state: job.state, progress: null });
    return live && goesOn(job.state) ? follow(job.id, set) : undefined;
  }, [job.id, job.state, live]);
  if (job.verdict && standing.state === "succeeded") return <Badge verdict={job.verdict} />;
  return (
    <>
      <State state={standing.state} />
      {goesOn(standing.state) && <Bar standing={standing} />}
    </>
  );
}

/** What a listing tells of a result. */
function Figures({ of }: { of: JobSummary }) {
  const { compensation, joints_identified: found, joint_count: count, warning_count: warnings } = of;
  const told = [
    [compensation === null ? null : percent(compensation), text.lists.explained],
    [found === null ? null : text.evidence.rankOf(found, count ?? found), text.lists.joints],
    [warnings ? String(warnings) : null, text.lists.warnings(warnings ?? 0)],
  ];
  return (
    <span class="figures">
      {told.map(([value, label]) => (
        <span>
          {value && (
            <>
              <b>{value}</b> <small>{label}</small>
            </>
          )}
        </span>
      ))}
    </span>
  );
}

/** The listing page by page; its first page is asked for again when one comes back to the browser's tab. */
function usePages<Of extends Collection>(collection: Of, filters: Record<string, string>) {
  type Item = Summary<Of>;
  const [items, setItems] = useState<Item[] | null>(null);
  const [next, setNext] = useState<string | null>(null);
  const [problem, setProblem] = useState<Problem | null>(null);
  const asked = useRef(0);
  const count = useRef(0);
  count.current = items?.length ?? 0;
  const ask = (cursor: string | null) => {
    const round = ++asked.current;
    setProblem(null);
    (api[collection].list({ ...filters, limit: PAGE, cursor }) as Promise<Page<Item>>).then(
      (page) => {
        if (round !== asked.current) return; // another question was asked since
        setItems((before) => (cursor === null ? page.items : [...(before ?? []), ...page.items]));
        setNext(page.next);
      },
      (error: unknown) => round === asked.current && setProblem(problemOf(error)),
    );
  };
  useEffect(() => {
    setItems(null);
    ask(null);
    // What *More* brought stays: only a list of one page is asked for again.
    const stop = whenSeen(() => count.current <= PAGE && ask(null));
    return () => {
      asked.current++;
      stop();
    };
  }, [collection, JSON.stringify(filters)]);
  return {
    items,
    problem,
    load: () => ask(null),
    more: next === null ? null : () => ask(next),
    take: (id: string) => setItems((before) => before && before.filter((item) => item.id !== id)),
  };
}

/** As many are compared as there are marks. */
export const MOST_RUNS = 4;

function aboutRun(run: RunSummary, names: Names | null): About {
  const method = text.methods[run.method];
  return {
    name: names?.set(run.measurement_set_id) ?? "…",
    how: (
      <>
        {method}
        <small>{waysOf(run).join(", ")}</small>
      </>
    ),
    words: [method, text.glossary[run.method][0], ...waysOf(run)],
  };
}

/** Rows of runs for lists of their own. */
export const runRows = (runs: RunSummary[], names: Names | null): Row[] =>
  nested(
    runs.map((run) => rowOf("runs", run, names, false)),
    runs,
  );

/** The newest run of each set, the others beneath it. */
export const latestRows = (runs: RunSummary[], names: Names | null): Row[] =>
  [...groupedBy(runs, (run) => run.measurement_set_id).values()].flatMap((ofSet) => {
    const [newest, ...under] = ofSet.map((run) => rowOf("runs", run, names, false));
    return newest ? [{ ...newest, under }] : [];
  });

/** Rows of variants beneath that of the run they began with, whatever they vary in between. */
function nested(rows: Row[], runs: RunSummary[]): Row[] {
  const origins = new Map(runs.map((run) => [run.id, run.variant_of]));
  const shown = new Set(rows.map(({ id }) => id));
  const rootOf = (id: string): string => {
    const origin = origins.get(id);
    return origin && origins.has(origin) ? rootOf(origin) : id;
  };
  const families = groupedBy(rows, ({ id }) => (shown.has(rootOf(id)) ? rootOf(id) : id));
  return rows.flatMap((row) => {
    const family = families.get(row.id);
    return family ? [{ ...row, under: family.filter((one) => one !== row) }] : [];
  });
}

export function RunsView({ query }: { query: URLSearchParams }) {
  const [grouped, setGrouped] = useState(query.get("group") === "set");
  const [selected, setSelected] = useState<ReadonlySet<string>>(new Set());
  const share = useCallback(
    (search: Record<string, string>) => {
      const kept = new URLSearchParams({ ...search, ...(grouped ? { group: "set" } : {}) }).toString();
      history.replaceState(null, "", `#/runs${kept && `?${kept}`}`);
    },
    [grouped],
  );
  const select = (id: string, on: boolean) =>
    setSelected((before) => new Set(on ? [...before, id] : [...before].filter((one) => one !== id)));
  const few = selected.size < 2 || selected.size > MOST_RUNS;
  return (
    <>
      <Title plain={text.app.runs}>{text.app.runs}</Title>
      <JobList
        collection="runs"
        query={query}
        address={share}
        grouped={grouped}
        pick={(run, name) =>
          run.state === "succeeded" && (
            <label class="pick">
              <input
                type="checkbox"
                aria-label={text.lists.select(name)}
                checked={selected.has(run.id)}
                onChange={(event) => select(run.id, event.currentTarget.checked)}
              />
            </label>
          )
        }
      >
        <Toggle label={text.lists.groups} checked={grouped} change={setGrouped} />
      </JobList>
      {selected.size > 0 && (
        <div class="selection" role="region" aria-label={text.lists.selected(selected.size)}>
          <b>{text.lists.selected(selected.size)}</b>
          <Button
            look="primary"
            disabled={few}
            onClick={() => go(link(["compare", "runs"], { ids: [...selected].join(",") }))}
          >
            {text.app.compare}
          </Button>
          <Button look="quiet" onClick={() => setSelected(new Set())}>
            {text.lists.clear}
          </Button>
          {few && <small class="soft">{text.lists.selectTwo}</small>}
        </div>
      )}
    </>
  );
}
