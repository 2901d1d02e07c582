/** Robots and measurement sets: in lists, and each by itself, as it was understood. */
import { METADATA } from "../../api/types";
import type {
  DhModel,
  JointKind,
  JointMap,
  MeasurementSet,
  MeasurementSetSummary,
  Page,
  Robot,
  RobotSummary,
  RunSummary,
} from "../../api/types";
import { alike, DataTable } from "../../components/table";
import { dayText, fixed } from "../../lib/format";
import { degrees, position, positionUnit } from "../../lib/stiffness";
import { text } from "../../words";
import { api } from "../../api/calls";
import { queries } from "../../api/queries";
import {
  Busy,
  Button,
  LinkButton,
  MeasureLink,
  ProblemNote,
  Empty,
  Form,
  Head,
  Name,
  NameLink,
  Show,
  Tabs,
  Facts,
  Badge,
  Warnings,
  When,
} from "../../components/basics";
import { ROBOTS, robotsToldApart, SETS } from "../../state/choices";
import { ask, isKnown, type Pages, type PagesOptions, usePages, useQuery } from "../../state/query";
import { link, useAction } from "../../state/action";
import { useTypedValue } from "../../state/session";
import { JobList, MOST_RUNS, runRows } from "../runs/view";
import { type RunColumn, RunsTable } from "../run/stiffness";
import { keepPreviousData } from "@tanstack/query-core";
import type { ComponentChildren } from "preact";
import { ChangedJoints } from "../trend/changed";
import { LastCorrection, MeasuredNow, OverTime } from "./over_time";
import { Today } from "./today";
import { FilterBar, type Row, Rows, useFilter, StoredActions, wanted } from "../../components/list";
import { TextField } from "../../components/fields";
import { factsOf, measuredBetween, notedIn, type Typed, typedOf } from "../../lib/campaign";
import { MetadataForm } from "../../components/schema_form";
import { Preview } from "../../components/findings";
import { Arm } from "../../scene/view";
import { wallWords } from "../wall/words";
import { gearboxWords } from "../gearbox/words";
import { measureWords } from "../measure/words";
import { metadataWords, jointWords } from "../../components/words";
import { planWords } from "../plan/words";
import { robotWords } from "./words";
import { setWords } from "./words";

const words = robotWords;

/** Millimetres and degrees without the noise of their factors. */
const plain = (value: number): string => String(Number(value.toFixed(6))).replace("-", "\u2212");

/** Joints with their limits, and the rows of their DH table where there is one. */
export function JointsTable({ joints, rows }: { joints: Robot["joints"]; rows?: DhModel["rows"] }) {
  const { mm, deg } = text.units;
  const slides = joints.some(({ kind }) => kind === "prismatic");
  const limit = (value: number | null, kind: JointKind) =>
    value === null
      ? words[rows ? "unknown" : "unlimited"]
      : `${fixed(position(value, kind), 0)}${slides ? positionUnit(kind) : ""}`;
  return (
    <DataTable
      caption={rows ? words.table : words.limits}
      table={{
        columns: [
          text.run.joint,
          ...(rows
            ? (["a", "alpha", "d", "theta"] as const).map((name) => ({
                title: words.column[name],
                unit: name === "a" || name === "d" ? mm : deg,
                show: plain,
              }))
            : []),
          ...alike([words.lower, words.upper], slides ? undefined : deg),
        ],
        rows: joints.map(({ name, kind, lower, upper }, i) => {
          const row = rows?.[i];
          return [
            rows && slides ? `${i + 1}, ${jointWords.kinds[kind]}` : rows ? String(i + 1) : name,
            ...(row ? [row.a * 1e3, degrees(row.alpha), row.d * 1e3, degrees(row.theta)] : []),
            limit(lower, kind),
            limit(upper, kind),
          ];
        }),
      }}
    />
  );
}

export function JointMapTable({ map, kinds }: { map: JointMap; kinds: JointKind[] }) {
  const joints = map.matrix.map((_, i) => ({ title: String(i + 1), show: plain }));
  return (
    <DataTable
      caption={words.mapTable}
      table={{
        columns: [text.run.joint, ...joints, { title: words.offset, show: plain }],
        rows: map.matrix.map((row, i) => [
          `${i + 1} [${positionUnit(kinds[i]).trim()}]`,
          ...row,
          position(map.offset[i] ?? 0, kinds[i]),
        ]),
      }}
    />
  );
}

const MOST = 8;

type Measured = Pick<MeasurementSetSummary, "serial_number" | "measured_at">;

/** The newest run of each robot and serial number, the newest first; runs that vary another do not count. */
export function newestOf(runs: RunSummary[], sets: ReadonlyMap<string, Measured>): RunSummary[] {
  const time = (run: RunSummary) => Date.parse(sets.get(run.measurement_set_id)?.measured_at ?? run.created_at);
  const seen = new Set<string>();
  return runs
    .filter((run) => run.variant_of === null)
    .sort((a, b) => time(b) - time(a))
    .filter((run) => {
      const key = `${run.robot_id}\n${sets.get(run.measurement_set_id)?.serial_number ?? ""}`;
      return !seen.has(key) && seen.add(key);
    });
}

/** The newest runs of robots of one kind. */
async function twinsOf({ content_hash }: Robot): Promise<RunColumn[]> {
  const { items: alike } = await ask(queries.robots({ content_hash, limit: MOST }));
  if (alike.length < 2) return [];
  const names = robotsToldApart(alike);
  const [sets, runs] = await Promise.all([
    Promise.all(alike.map(({ id }) => ask(queries.sets({ ...SETS, robot_id: id })))),
    Promise.all(alike.map(({ id }) => ask(queries.runs({ robot_id: id, state: "succeeded", limit: 100 })))),
  ]);
  const byId = new Map(sets.flatMap(({ items }) => items.map((set) => [set.id, set])));
  const all = runs.flatMap(({ items }) => items);
  return Promise.all(
    newestOf(all, byId)
      .slice(0, MOST)
      .map(async ({ id, robot_id: of, measurement_set_id: setId, created_at: created }) => {
        const set = byId.get(setId);
        const encoders = set && text.files.encoders[set.encoders];
        const note = [set?.serial_number, dayText(set?.measured_at ?? created), encoders].filter(Boolean).join(", ");
        return { run: await ask(queries.run(id)), name: names.get(of) ?? id, note };
      }),
  );
}

/** Nothing, while there is only one robot of the kind. */
function Twins({ robot }: { robot: Robot }) {
  const found = useQuery({ queryKey: ["twins", robot.id], queryFn: () => twinsOf(robot) });
  if (!isKnown(found)) return <Busy />;
  const twins = found.data ?? [];
  if (twins.length < 2) return null;
  const ids = twins.slice(0, MOST_RUNS).map(({ run }) => run.id);
  return (
    <section class="card">
      <h2>{words.twins}</h2>
      <RunsTable columns={twins} label={words.twins} />
      <LinkButton href={link(["compare", "runs"], { ids: ids.join() })}>{words.beside}</LinkButton>
    </section>
  );
}

export function RobotsView({ list, query }: { list: "robots" | "sets"; query: URLSearchParams }) {
  const title = list === "robots" ? text.app.robots : words.sets;
  return (
    <>
      <Head
        plain={title}
        first={
          <LinkButton look="primary" href={list === "robots" ? "#/robots/new" : "#/"}>
            {list === "robots" ? words.add : text.app.measure}
          </LinkButton>
        }
      />
      <RobotTabs current={list} />
      {list === "robots" ? <RobotList query={query} /> : <SetList query={query} />}
    </>
  );
}

/** A listing page by page; what was found before stays until the new answer is there. */
function useStored<Item>(
  name: string,
  filters: object,
  list: (page: { limit: number; cursor: string | null }, signal: AbortSignal) => Promise<Page<Item>>,
) {
  const options: PagesOptions<Page<Item>> = {
    queryKey: ["list", name, filters],
    queryFn: ({ pageParam: cursor, signal }) => list({ limit: 100, cursor }, signal),
    initialPageParam: null,
    getNextPageParam: ({ next }) => next,
    placeholderData: keepPreviousData,
    refetchOnWindowFocus: ({ state }) => (state.data?.pages.length ?? 0) < 2,
  };
  return usePages(options);
}

interface FoundProps<Item> {
  of: Pages<Page<Item>>;
  row: (item: Item, names: Map<string, string>) => Row;
  /** Names of the items where several have the same. */
  names?: (items: Item[]) => Map<string, string>;
  /** Shown where nothing is stored. */
  none: ComponentChildren;
  filtered: boolean;
}

/** What a search found, and how many there are. */
function Found<Item>({ of, row, names = () => new Map(), none, filtered }: FoundProps<Item>) {
  if (of.problem) return <ProblemNote problem={of.problem} retry={of.refetch} />;
  if (!of.data) return <Busy />;
  const items = of.data.flatMap((page) => page.items);
  const total = of.data[0]?.total ?? items.length;
  if (items.length === 0)
    return filtered ? <Empty title={text.list.noMatch} hint={text.list.noMatchHint} /> : <>{none}</>;
  const named = names(items);
  return (
    <>
      <p class="soft" role="status">
        {text.list.count(items.length, total)}
      </p>
      <Rows rows={items.map((item) => row(item, named))} />
      {of.more && <Button onClick={of.more}>{text.app.more}</Button>}
    </>
  );
}

function RobotList({ query }: { query: URLSearchParams }) {
  const [filter, change] = useFilter(query);
  const filters = wanted(filter);
  const robots = useStored("robots", filters, (page, signal) => api.robots.list({ ...filters, ...page }, signal));
  return (
    <section class="list">
      <FilterBar filter={filter} change={change} />
      <Found of={robots} row={robotRow} names={robotsToldApart} none={<NoRobots />} filtered={filters.q !== null} />
    </section>
  );
}

/** Measurement sets: all, by the search of the address, or those of a robot. */
export function SetList({ robot, query }: { robot?: string; query?: URLSearchParams }) {
  const [filter, change] = useFilter(query);
  const filters = {
    ...wanted(filter),
    robot_id: robot ?? (filter.robot || null),
    ...measuredBetween(filter),
  };
  const sets = useStored("sets", filters, (page, signal) => api.sets.list({ ...filters, ...page }, signal));
  const { data: robots } = useQuery({ ...queries.robots(ROBOTS), enabled: robot === undefined });
  const names = robotsToldApart(robots?.items ?? []);
  const day = (end: "from" | "to") => (
    <TextField
      type="date"
      label={metadataWords[end]}
      value={filter[end]}
      change={(typed) => change({ [end]: typed })}
    />
  );
  const { sort: _, ...narrowing } = { ...filters, robot_id: robot ? null : filters.robot_id };
  return (
    <section class="list">
      {robot !== undefined && <h2>{words.sets}</h2>}
      <FilterBar filter={filter} change={change} robots={robot === undefined}>
        {day("from")}
        {day("to")}
      </FilterBar>
      <Found
        of={sets}
        row={(set) => setRow(set, names.get(set.robot_id))}
        none={<NoSets />}
        filtered={Object.values(narrowing).some((value) => value !== null)}
      />
    </section>
  );
}

function robotRow(robot: RobotSummary, names: Map<string, string>): Row {
  const toldApart = (names.get(robot.id) ?? "").slice(robot.name.length + " · ".length); // where another has its name
  const joints = toldApart || text.lists.jointCount(robot.joints.length);
  return {
    id: robot.id,
    href: link(["robots", robot.id]),
    name: robot.name,
    note: <Name>{joints + (robot.nominal_arm ? `, ${words.nominal}` : "")}</Name>,
    how: robot.last_campaign?.serial_number && <Name>{robot.last_campaign.serial_number}</Name>,
    at: robot.last_campaign?.at ?? null,
    standing: (
      <>
        {robot.last_campaign && <Badge verdict={robot.last_campaign.verdict} />}
        <ChangedJoints of={robot.last_campaign} />
      </>
    ),
  };
}

function setRow(set: MeasurementSetSummary, robot = ""): Row {
  return {
    id: set.id,
    href: link(["sets", set.id]),
    name: set.name,
    note: <Name>{[robot, set.serial_number].filter(Boolean).join(", ")}</Name>,
    how: (
      <>
        {setWords.observations(set.observation_count)}
        <small>{text.files.encoders[set.encoders]}</small>
      </>
    ),
    at: set.measured_at ?? set.created_at,
    standing: set.warning_count > 0 && <span class="state warn">{text.files.findings(set.warning_count)}</span>,
  };
}

/** There is no robot yet, and how to add one. */
export const NoRobots = () => (
  <Empty title={words.none} hint={words.noneHint}>
    <LinkButton look="primary" href="#/robots/new">
      {words.add}
    </LinkButton>
  </Empty>
);

export const NoSets = () => (
  <Empty title={words.setsNone} hint={words.setsNoneHint}>
    <MeasureLink />
  </Empty>
);

/** Robots, their sets, their gearboxes, and the wall: four lists of one section. */
export function RobotTabs({ current }: { current: "robots" | "sets" | "gearboxes" | "wall" }) {
  return (
    <Tabs
      label={words.tabs}
      current={current}
      tabs={[
        { id: "robots", label: text.app.robots, href: "#/robots" },
        { id: "sets", label: words.sets, href: "#/sets" },
        { id: "gearboxes", label: gearboxWords.title, href: "#/gearboxes" },
        { id: "wall", label: wallWords.title, href: "#/wall" },
      ]}
    />
  );
}

export function RobotView({ id }: { id: string }) {
  const loaded = useQuery(queries.robot(id));
  return (
    <Show of={loaded} title={text.start.robot} restore={() => api.robots.restore(id)}>
      {(robot) => <RobotPage robot={robot} />}
    </Show>
  );
}

/** Whether an arm of another serial number changed than the one that was measured last. */
const changedElsewhere = ({ last_campaign: last }: Robot): boolean =>
  last?.changed.some(({ serial_number: serial }) => serial !== last.serial_number) ?? false;

function RobotPage({ robot }: { robot: Robot }) {
  const { data: sets } = useQuery(queries.sets({ robot_id: robot.id, limit: 1 }));
  const last = robot.last_campaign;
  const trend = useQuery({
    ...queries.trend(robot.id, { serial_number: last?.serial_number ?? null }),
    enabled: last !== null,
  });
  return (
    <>
      <Head
        kind={text.start.robot}
        plain={robot.name}
        title={<Name>{robot.name}</Name>}
        about={
          <>
            <span>{text.lists.jointCount(robot.joints.length)}</span>
            {sets?.total != null && <span>{words.setCount(sets.total)}</span>}
            <a href={link(["compare", "trend", robot.id])}>{words.trend}</a>
          </>
        }
        first={
          <LinkButton look="primary" href={link([], { robot: robot.id })}>
            {text.app.measure}
          </LinkButton>
        }
      >
        <LinkButton href={link(["measure"], { robot: robot.id })}>{measureWords.title}</LinkButton>
        <LinkButton href={link(["plans"], { robot: robot.id })}>{planWords.begin}</LinkButton>
        <StoredActions of={robot} api={api.robots} list="#/robots" />
      </Head>
      {changedElsewhere(robot) && (
        <p class="note bad">
          <ChangedJoints of={robot.last_campaign} />
        </p>
      )}
      {last && <Today robot={robot} last={last} trend={trend.data} known={isKnown(trend)} />}
      <MeasuredNow robot={robot} />
      {trend.data && <OverTime robot={robot} trend={trend.data} />}
      <LastCorrection robot={robot} />
      <div class="flow">
        <section class="card">
          <Arm source={{ robot_id: robot.id }} start={null} />
        </section>
        <section class="card">
          <h2>{words.facts}</h2>
          <Kinematics robot={robot} />
        </section>
      </div>
      <Twins robot={robot} />
      <SetList robot={robot.id} />
      {sets && sets.items.length > 0 && (
        <section>
          <h2>{text.app.runs}</h2>
          <JobList collection="runs" about={{ robot_id: robot.id }} />
        </section>
      )}
    </>
  );
}

function Kinematics({ robot }: { robot: Robot }) {
  const miss = robot.wrist_miss_distance;
  return (
    <>
      {robot.nominal_arm && <p class="note warn">{words.nominalNote}</p>}
      <Facts
        facts={[
          robot.nominal_arm && { label: words.nominalArm, value: <Name>{robot.nominal_arm}</Name> },
          robot.payload != null && { label: words.payload, value: `${robot.payload} kg` },
          {
            label: words.description,
            value:
              robot.model.format === "dh"
                ? `${words.dh}, ${jointWords.conventions[robot.model.convention]}`
                : words.urdf,
          },
          {
            label: words.wrist,
            value: robot.spherical_wrist
              ? words.spherical
              : miss === null
                ? words.noCentre
                : words.notSpherical(`${fixed(miss * 1e3, 2)} ${text.units.mm}`),
          },
          ...(robot.joint_map ? [] : [{ label: words.map, value: words.identity }]),
        ]}
      />
      <JointsTable joints={robot.joints} {...(robot.model.format === "dh" ? { rows: robot.model.rows } : {})} />
      {robot.joint_map && (
        <>
          <h3>{words.map}</h3>
          <JointMapTable map={robot.joint_map} kinds={robot.joints.map(({ kind }) => kind)} />
        </>
      )}
    </>
  );
}

export function SetView({ id }: { id: string }) {
  const loaded = useQuery(queries.set(id));
  return (
    <Show of={loaded} title={text.sets.kind} restore={() => api.sets.restore(id)}>
      {(set) => <SetPage set={set} />}
    </Show>
  );
}

function SetPage({ set }: { set: MeasurementSet }) {
  const ofSet = useQuery(queries.robot(set.robot_id));
  const robot = ofSet.data;
  const runs = useQuery(queries.runs({ measurement_set_id: set.id, limit: 100 })).data?.items;
  if (!isKnown(ofSet)) return <Busy />;
  return (
    <>
      <Head
        kind={text.sets.kind}
        plain={set.name}
        title={<Name>{set.name}</Name>}
        about={
          <>
            <NameLink to={["robots", set.robot_id]}>{robot?.name ?? "…"}</NameLink>
            <span>{setWords.observations(set.observations.length)}</span>
            <When time={set.measured_at ?? set.created_at} />
          </>
        }
        first={
          <LinkButton look="primary" href={link([], { set: set.id })}>
            {text.app.measure}
          </LinkButton>
        }
      >
        <LinkButton href={link(["compare", "methods"], { set: set.id })}>{text.sets.compare}</LinkButton>
        <LinkButton href={link(["plans"], { set: set.id })}>{planWords.goOn}</LinkButton>
        <StoredActions of={set} api={api.sets} list="#/sets" />
      </Head>
      <div class="flow">
        <section class="card">
          <h2>{text.files.understood}</h2>
          <Preview facts={factsOf(set as never)} />
        </section>
        <SetMetadata set={set} />
        <section class="card">
          <h2>{setWords.findings}</h2>
          {set.warnings.length > 0 ? <Warnings warnings={set.warnings} /> : <p class="note good">{text.files.clean}</p>}
        </section>
      </div>
      {runs && runs.length > 0 && (
        <section>
          <h2>{setWords.runs}</h2>
          <Rows rows={runRows(runs)} />
        </section>
      )}
    </>
  );
}

/** What people noted about a set, and the form to change it: the readings stay as they are. */
export function SetMetadata({ set }: { set: MeasurementSet }) {
  const words = metadataWords;
  /** What is typed; null while nothing is changed. */
  const [typed, setTyped] = useTypedValue<Typed | null>(`noted/${set.id}`, null);
  const noted = typed && notedIn(typed);
  const save = useAction(async () => {
    if (!noted) return;
    await api.sets.change(set.id, noted);
    setTyped(null);
  });
  const known = METADATA.filter((name) => set[name]);
  return (
    <section class="card">
      <h2>{words.title}</h2>
      {typed ? (
        <Form action={save} class="noting">
          <MetadataForm typed={typed} change={setTyped} />
          <div class="actions">
            <Button acts type="submit" look="primary" disabled={save.busy || !noted}>
              {words.save}
            </Button>
            <Button onClick={() => setTyped(null)}>{words.cancel}</Button>
          </div>
        </Form>
      ) : (
        <>
          {known.length === 0 ? (
            <p class="soft">{words.none}</p>
          ) : (
            <Facts
              facts={known.map((name) => ({
                label: words.fields[name],
                value: name === "measured_at" ? <When time={set[name] ?? ""} /> : <Noted>{set[name] ?? ""}</Noted>,
              }))}
            />
          )}
          <Button onClick={() => setTyped(typedOf(set))} acts>
            {known.length === 0 ? words.add : words.edit}
          </Button>
        </>
      )}
    </section>
  );
}

/** A text that someone else chose, in its lines. */
const Noted = ({ children }: { children: string }) => <bdi class="name noted">{children}</bdi>;
