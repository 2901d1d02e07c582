/** Jobs of a kind, listed, filtered, followed, deleted with undo; runs among them, variants beneath the run they vary. */
import type { ComponentChildren } from "preact";
import { keepPreviousData } from "@tanstack/query-core";
import { useEffect, useState } from "preact/hooks";
import { api, type Collection, type JobQuery, type Summary } from "../../api/calls";
import { follow, goesOn, type Standing } from "../../api/follow";
import { problemOf } from "../../api/problem";
import type { JobSummary, Page, RunSummary } from "../../api/types";
import { DeleteButton, type Filter, FilterBar, type Row, Rows, useFilter, wanted } from "../../components/list";
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
} from "../../components/basics";
import { Select } from "../../components/fields";
import { percent } from "../../lib/format";
import { groupedBy } from "../../lib/json";
import { client, send, usePages } from "../../state/query";
import { link, readdress, toast, go } from "../../state/action";
import { useKeptOnEntry } from "../../state/entry";
import { text } from "../../words";
import { unusualWays } from "../../lib/ways";
import { evidenceWords } from "../run/words";
import { runListWords } from "./words";

const words = text.list;
/** A browser keeps six connections to a host; those that are followed must leave some for the rest of the page. */
const FOLLOWED = 3;
const PAGE = 100;

type About = Pick<Row, "name"> & Partial<Row>;

/** What jobs of each kind are about. */
const ABOUT: { [Of in Collection]: (item: Summary<Of>) => About } = {
  runs: aboutRun,
  comparisons: ({ name, measurement_set_name: first, second_set_id: second }) => ({
    name: name ?? (second ? `${first ?? "…"} → …` : (first ?? "…")),
  }),
  geometries: ({ name }) => ({ name: name ?? "…" }),
  gearboxes: ({ name }) => ({ name: name ?? "…" }),
  plans: ({ measurement_set_name: set, robot_name: robot }) => ({ name: set ?? robot ?? "…" }),
  maps: ({ name }) => ({ name: name ?? text.run.views.map }),
  corrections: ({ name }) => ({ name: name ?? text.run.views.correct }),
};

/** A job as a row. */
function rowOf<Of extends Collection>(collection: Of, item: Summary<Of>, live = true): Row {
  const job = item as JobSummary;
  const robot = [job.robot_name, job.serial_number].filter(Boolean).join(", ");
  return {
    id: job.id,
    href: link(collection === "comparisons" ? ["compare", "methods", job.id] : [collection, job.id]),
    note: robot && <Name>{robot}</Name>,
    figures: job.verdict && job.joint_count && <Figures of={job} />,
    at: job.created_at,
    standing: <JobStanding job={job} live={live} />,
    ...ABOUT[collection](item),
  };
}

interface ListProps<Of extends Collection> {
  collection: Of;
  /** Which jobs are listed at all. */
  about?: Record<string, string>;
  /** The search of the address, which is the filter. */
  query?: URLSearchParams;
  /** What picks a job, before its row. */
  pick?: (item: Summary<Of>, name: string) => ComponentChildren;
  /** Runs under headings of their sets. */
  grouped?: boolean;
  /** Beside the filters. */
  children?: ComponentChildren;
}

export function JobList<Of extends Collection>(props: ListProps<Of>) {
  const { collection, about = {}, query, pick, grouped = false, children } = props;
  const title = (text.earlier as Partial<Record<Collection, string>>)[collection]; // of runs it is the page's
  const [filter, change] = useFilter(query);
  const { state, robot, verdict } = filter;
  const deleted = state === "deleted";
  const listed = useListed(collection, {
    ...about,
    ...wanted(filter),
    ...(deleted ? { deleted } : state === "all" ? {} : { state }),
    ...(robot && { robot_id: robot }),
    ...(verdict && { verdict }),
  });
  const items = listed.data?.flatMap((page) => page.items) ?? null;
  const total = listed.data?.[0]?.total ?? items?.length ?? 0;

  const failed = (error: unknown) => toast(problemOf(error).detail);
  const restore = (item: Summary<Of>) =>
    void send(() => api.jobs.restore(item.id)).then(() => toast(words.restored), failed);
  const remove = (item: Summary<Of>, name: string) =>
    void send(() => api.jobs.delete(item.id)).then(
      () => toast(text.deletion.done(name), { label: text.runs.undo, run: () => restore(item) }),
      failed,
    );
  const live = new Set((items ?? []).filter(({ state }) => goesOn(state)).slice(0, FOLLOWED));
  const rows = (items ?? []).map((item): Row => {
    const row = rowOf(collection, item, live.has(item));
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
  const plain = state === "all" && robot === "" && verdict === "" && filter.q.trim() === "";
  const runs = collection === "runs" ? (items as RunSummary[] | null) : null;
  const sets = new Map(grouped ? runs?.map((run) => [run.id, run.measurement_set_id]) : []);
  const setNames = new Map(runs?.map((run) => [run.measurement_set_id, run.measurement_set_name]));
  const groups = groupedBy(runs ? nested(rows, runs) : rows, ({ id }) => sets.get(id));
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
      <FilterBar filter={filter} change={change} robots={!("robot_id" in about)} judged>
        <Select
          label={runListWords.state}
          value={state}
          change={(chosen) => change({ state: chosen as Filter["state"] })}
          options={{ all: text.app.all, ...text.states, deleted: words.deletedState }}
        />
        {children}
      </FilterBar>
      {deleted && <p class="soft">{words.deletedHint}</p>}
      {listed.problem && <ProblemNote problem={listed.problem} retry={listed.refetch} />}
      {items === null && !listed.problem && <Busy />}
      {items && items.length > 0 && (
        <p class="soft" role="status">
          {words.count(items.length, total)}
        </p>
      )}
      {[...groups].map(([set, members]) => (
        <section>
          {set !== undefined && (
            <h2 class="group">
              <NameLink to={["sets", set]}>{setNames.get(set) ?? set}</NameLink>
            </h2>
          )}
          <Rows rows={members} />
        </section>
      ))}
      {items?.length === 0 && nothing}
      {listed.more && <Button onClick={listed.more}>{text.app.more}</Button>}
    </section>
  );
}

/** Verdict, or state and progress, live while the job goes on and is followed. */
function JobStanding({ job, live }: { job: JobSummary; live: boolean }) {
  const [standing, set] = useState<Standing>({ id: job.id, state: job.state, progress: null });
  useEffect(() => {
    set({ id: job.id, state: job.state, progress: null });
    if (!live || !goesOn(job.state)) return undefined;
    return follow(job.id, (now, ended) => {
      set(now);
      if (ended) void client.invalidateQueries({ queryKey: ["list"] }); // its verdict stands in the listing
    });
  }, [job.id, job.state, live]);
  if (job.verdict && standing.state === "succeeded") return <Badge verdict={job.verdict} />;
  return (
    <>
      <State state={standing.state} />
      {standing.state === "running" && standing.progress && <small>{text.run.progressOf(standing.progress)}</small>}
    </>
  );
}

/** What a listing tells of a result. */
function Figures({ of }: { of: JobSummary }) {
  const { compensation, joints_identified: found, joint_count: count, warning_count: warnings } = of;
  const told = [
    [compensation === null ? null : percent(compensation), runListWords.explained],
    [found === null ? null : evidenceWords.rankOf(found, count ?? found), runListWords.joints],
    [warnings ? String(warnings) : null, runListWords.warnings(warnings ?? 0)],
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

/** The listing page by page; what was found before stays until the new answer is there. */
const useListed = <Of extends Collection>(collection: Of, filters: JobQuery) =>
  usePages<Page<Summary<Of>>>({
    queryKey: ["list", collection, filters],
    queryFn: ({ pageParam: cursor, signal }) =>
      api[collection].list({ ...filters, limit: PAGE, cursor }, signal) as never,
    initialPageParam: null,
    getNextPageParam: ({ next }) => next,
    placeholderData: keepPreviousData,
    // A long list is not fetched anew, page by page, whenever one comes back to the browser's tab.
    refetchOnWindowFocus: ({ state }) => (state.data?.pages.length ?? 0) < 2,
  });

/** As many are compared as there are marks. */
export const MOST_RUNS = 4;

function aboutRun(run: RunSummary): About {
  const ways = unusualWays(run);
  return { name: run.measurement_set_name ?? "…", ...(ways && { how: ways }) };
}

/** Rows of runs for lists of their own. */
export const runRows = (runs: RunSummary[]): Row[] =>
  nested(
    runs.map((run) => rowOf("runs", run, false)),
    runs,
  );

/** The newest run of each set, the others beneath it. */
export const latestRows = (runs: RunSummary[]): Row[] =>
  [...groupedBy(runs, (run) => run.measurement_set_id).values()].flatMap((ofSet) => {
    const [newest, ...under] = ofSet.map((run) => rowOf("runs", run, false));
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
  const grouped = query.get("group") === "set";
  const group = (on: boolean) =>
    readdress((now) => {
      const { group: _, ...others } = Object.fromEntries(now);
      return on ? { ...others, group: "set" } : others;
    });
  const [selected, setSelected] = useKeptOnEntry<string[]>("selected", []);
  const select = (id: string, on: boolean) =>
    setSelected((before) => {
      const others = before.filter((one) => one !== id);
      return on ? [...others, id] : others;
    });
  const few = selected.length < 2 || selected.length > MOST_RUNS;
  return (
    <>
      <Title plain={text.app.runs}>{text.app.runs}</Title>
      <JobList
        collection="runs"
        query={query}
        grouped={grouped}
        pick={(run, name) =>
          run.state === "succeeded" && (
            <label class="pick">
              <input
                type="checkbox"
                aria-label={runListWords.select(name)}
                checked={selected.includes(run.id)}
                onChange={(event) => select(run.id, event.currentTarget.checked)}
              />
            </label>
          )
        }
      >
        <Toggle label={runListWords.groups} checked={grouped} change={group} />
      </JobList>
      {selected.length > 0 && (
        <div class="selection" role="region" aria-label={runListWords.selected(selected.length)}>
          <b>{runListWords.selected(selected.length)}</b>
          <Button
            look="primary"
            disabled={few}
            onClick={() => go(link(["compare", "runs"], { ids: selected.join(",") }))}
          >
            {text.app.compare}
          </Button>
          <Button look="quiet" onClick={() => setSelected(() => [])}>
            {runListWords.clear}
          </Button>
          {few && <small class="soft">{text.lists.selectTwo}</small>}
        </div>
      )}
    </>
  );
}
