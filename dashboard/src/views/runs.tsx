/** Jobs of a kind, listed, filtered, followed, deleted with undo; runs among them, variants beneath the run they vary. */
import type { ComponentChildren } from "preact";
import { useEffect, useRef, useState, useCallback } from "preact/hooks";
import { api, problemOf, type Collection, follow, goesOn, type Standing } from "../api/client";
import type { Page, Problem, RunRequest, RunState, RunSummary, Usability } from "../api/types";
import { AlarmState, chosen, FilterBar, type Row, Rows, useFilter } from "../components/list";
import {
  Badge,
  Busy,
  Button,
  Empty,
  Icon,
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
import { whenSeen, type Names, useNames, valueOf } from "../state/load";
import { link, toast, go } from "../state/action";
import { text } from "../i18n";

const words = text.list;
/** A browser keeps six connections to a host; those that are followed must leave some for the rest of the page. */
const FOLLOWED = 3;
const STATES = ["all", "succeeded", "running", "failed", "cancelled", "deleted"] as const;
type Shown = (typeof STATES)[number];

export type Summary<Of extends Collection> = Awaited<ReturnType<(typeof api)[Of]["list"]>>["items"][number];

/** What all jobs tell in a listing; what has numbers of joints has all that is told of a run. */
interface Listed {
  id: string;
  robot_id: string | null;
  state: RunState;
  created_at: string;
  verdict?: Usability | null;
  joint_count?: number | null;
}

const addressOf = (collection: Collection, id: string): string =>
  link(collection === "comparisons" ? ["compare", "methods", id] : [collection, id]);

/** A job as a row; `row` says what it is about. */
export function jobRow<Of extends Collection>(
  collection: Of,
  item: Summary<Of>,
  names: Names | null,
  row: Pick<Row, "name"> & Partial<Row>,
  live = true,
): Row {
  const job = item as Listed;
  const set = (item as Partial<RunSummary>).measurement_set_id;
  const robot = job.robot_id === null ? "" : (names?.robot(job.robot_id) ?? "…");
  return {
    id: job.id,
    href: addressOf(collection, job.id),
    note: robot && <Name>{robot}</Name>,
    figures: job.verdict && job.joint_count && <Figures of={item as RunSummary} />,
    at: job.created_at,
    standing: (
      <>
        <JobStanding job={job} live={live} />
        {job.robot_id && set && <AlarmState alarms={names?.alarms(job.robot_id, set) ?? []} />}
      </>
    ),
    robot: job.robot_id,
    verdict: job.verdict ?? null,
    ...row,
    words: [robot, text.states[job.state], ...(row.words ?? [])],
  };
}

export function JobList<Of extends Collection>({
  collection,
  about = {},
  names,
  title,
  row,
  query,
  address,
  pick,
  arrange = (rows) => [[null, rows]],
  children,
}: {
  collection: Of;
  /** Which jobs are listed at all. */
  about?: Record<string, string>;
  names: Names | null;
  /** Heading, unless the page's title is it. */
  title?: string;
  row: (item: Summary<Of>) => Pick<Row, "name"> & Partial<Row>;
  query?: URLSearchParams;
  /** Hear the search as parameters of an address, to be shared. */
  address?: (query: Record<string, string>) => void;
  /** What picks a job, before its row. */
  pick?: (item: Summary<Of>) => ComponentChildren;
  /** Rows under headings. */
  arrange?: (rows: Row[], items: Summary<Of>[]) => [ComponentChildren, Row[]][];
  /** Beside the filters. */
  children?: ComponentChildren;
}) {
  const [filter, change] = useFilter(query);
  const [shown, setShown] = useState<Shown>((query?.get("state") as Shown | null) ?? "all");
  const deleted = shown === "deleted";
  const { items, more, problem, load, take, put } = usePages(collection, {
    ...about,
    ...(deleted ? { deleted: "true" } : shown === "all" ? {} : { state: shown }),
    ...(filter.robot && { robot_id: filter.robot }),
    ...(filter.verdict && { verdict: filter.verdict }),
  });
  useEffect(() => {
    const { sort, ...kept } = { ...filter, state: shown === "all" ? "" : shown };
    const said = { ...kept, sort: sort === "newest" ? "" : sort };
    address?.(Object.fromEntries(Object.entries(said).filter(([, value]) => value !== "")));
  }, [filter, shown, address]);

  const failed = (error: unknown) => toast(problemOf(error).detail);
  const restore = (item: Summary<Of>) =>
    void api.jobs.restore(item.id).then(() => {
      if (deleted) take(item.id);
      else put(item);
      toast(words.restored);
    }, failed);
  const remove = (item: Summary<Of>, name: string) => {
    take(item.id);
    api.jobs.delete(item.id).then(
      () => toast(words.deleted(name), { label: text.runs.undo, run: () => restore(item) }),
      (error: unknown) => {
        put(item);
        failed(error);
      },
    );
  };
  const live = new Set((items ?? []).filter(({ state }) => goesOn(state)).slice(0, FOLLOWED));
  const rows = (items ?? []).map((item): Row => {
    const about = jobRow(collection, item, names, row(item), live.has(item));
    if (deleted) {
      const actions = (
        <Button onClick={() => restore(item)} acts>
          {text.lists.restore}
        </Button>
      );
      return { ...about, href: undefined, actions };
    }
    const actions = !goesOn(item.state) && (
      <Button
        acts
        look="quiet icon"
        aria-label={words.delete(about.name)}
        title={text.run.delete}
        onClick={() => remove(item, about.name)}
      >
        <Icon d="M5 7h14M10 7V5h4v2M7 7l1 12h8l1-12M10.5 11v5M13.5 11v5" />
      </Button>
    );
    return { ...about, actions, pick: pick?.(item) };
  });
  const found = chosen(rows, filter);
  const plain = shown === "all" && filter.robot === "" && filter.verdict === "";
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
      {title !== undefined && <h2>{title}</h2>}
      <FilterBar filter={filter} change={change} names={"robot_id" in about ? null : names} judged>
        <Select
          label={text.runs.state}
          value={shown}
          change={(state) => setShown(state as Shown)}
          options={STATES.map((value) => ({ value, label: words.states[value] }))}
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
      {arrange(found, items ?? []).map(([heading, members]) => (
        <section>
          {heading}
          {members.length > 0 && <Rows rows={members} />}
        </section>
      ))}
      {items && found.length === 0 && nothing}
      {more && <Button onClick={more}>{text.app.more}</Button>}
    </section>
  );
}

/** Verdict, or state and progress, live while the job goes on and is followed. */
function JobStanding({ job, live }: { job: Listed; live: boolean }) {
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
function Figures({ of }: { of: RunSummary }) {
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
  const ask = (cursor: string | null, hear: (page: Page<Item>) => void, isGone = () => false) => {
    setProblem(null);
    (api[collection].list({ ...filters, limit: 100, cursor }) as Promise<Page<Item>>).then(
      (page) => {
        if (isGone()) return;
        hear(page);
        setNext(page.next);
      },
      (error: unknown) => isGone() || setProblem(problemOf(error)),
    );
  };
  const pages = useRef(1);
  const first = (page: Page<Item>) => {
    pages.current = 1;
    setItems(page.items);
  };
  useEffect(() => {
    let gone = false;
    setItems(null);
    ask(null, first, () => gone);
    // What *More* brought stays: only a list of one page is asked for again.
    const stop = whenSeen(() => {
      if (pages.current === 1) ask(null, first, () => gone);
    });
    return () => {
      gone = true;
      stop();
    };
  }, [collection, JSON.stringify(filters)]);
  return {
    items,
    problem,
    load: () => ask(null, first),
    more:
      next === null
        ? null
        : () =>
            ask(next, (page) => {
              pages.current += 1;
              setItems((before) => [...(before ?? []), ...page.items]);
            }),
    take: (id: string) => setItems((before) => before?.filter((item) => item.id !== id) ?? null),
    put: (item: Item) => setItems((before) => [...(before ?? []), item]),
  };
}

/** As many are compared as there are marks. */
export const MOST_RUNS = 4;

type Asked = Pick<RunSummary, "method" | "positive" | "weighting" | "elasticity" | "leave_out" | "variant_of"> &
  Partial<Pick<RunRequest, "loss">>;

/** How a run was made: its method, then what is not usual. */
const waysOf = ({ positive, weighting, elasticity, loss, leave_out: left, variant_of: origin }: Asked): string[] => [
  positive ? text.options.constrained : text.options.unconstrained,
  ...(weighting === "covariance" ? [] : [text.weightings[weighting]]),
  ...(elasticity === "joints" || elasticity === "automatic" ? [] : [text.elasticities[elasticity]]),
  ...(loss === "huber" ? [text.assessment.changed.loss.huber] : []),
  ...(left.length > 0 ? [text.lists.without(left)] : []),
  ...(origin === null ? [] : [text.assessment.variant]),
];

export const howOf = (run: Asked): string => [text.methods[run.method], ...waysOf(run)].join(", ");

/** What a run is about, as a row says it. */
function rowOf(run: RunSummary, names: Names | null): Pick<Row, "name"> & Partial<Row> {
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
    runs.map((run) => jobRow("runs", run, names, rowOf(run, names), false)),
    runs,
  );

export const RunList = ({ runs, names }: { runs: RunSummary[]; names: Names | null }) => (
  <Rows rows={runRows(runs, names)} />
);

/** Rows of variants beneath that of the run they began with, whatever they vary in between. */
function nested(rows: Row[], runs: RunSummary[]): Row[] {
  const origins = new Map(runs.map((run) => [run.id, run.variant_of]));
  const shown = new Set(rows.map(({ id }) => id));
  const rootOf = (id: string): string => {
    const origin = origins.get(id);
    return origin && origins.has(origin) ? rootOf(origin) : id;
  };
  const families = Map.groupBy(rows, ({ id }) => (shown.has(rootOf(id)) ? rootOf(id) : id));
  return rows.flatMap((row) => {
    const family = families.get(row.id);
    return family ? [{ ...row, under: family.filter((one) => one !== row) }] : [];
  });
}

export function RunsView({ query }: { query: URLSearchParams }) {
  const [grouped, setGrouped] = useState(query.get("group") === "set");
  const [selected, setSelected] = useState<ReadonlySet<string>>(new Set());
  const names = valueOf(useNames());
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
      <Title plain={text.runs.title}>{text.runs.title}</Title>
      <JobList
        collection="runs"
        names={names}
        query={query}
        address={share}
        row={(run) => rowOf(run, names)}
        pick={(run) =>
          run.state === "succeeded" && (
            <label class="pick">
              <input
                type="checkbox"
                aria-label={text.lists.select(names?.set(run.measurement_set_id) ?? run.id)}
                checked={selected.has(run.id)}
                onChange={(event) => select(run.id, event.currentTarget.checked)}
              />
            </label>
          )
        }
        arrange={(rows, runs) => {
          const sets = new Map(runs.map((run) => [run.id, run.measurement_set_id]));
          const groups = Map.groupBy(nested(rows, runs), ({ id }) => (grouped ? sets.get(id) : undefined));
          return [...groups].map(([set, members]) => [
            set !== undefined && (
              <h2 class="group">
                <NameLink to={["sets", set]}>{names?.set(set) ?? set}</NameLink>
              </h2>
            ),
            members,
          ]);
        }}
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
            {text.lists.compare}
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
