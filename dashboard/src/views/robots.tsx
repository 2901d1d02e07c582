/** Robots and measurement sets: in lists, and each by itself, as it was understood. */
import { METADATA } from "../api/types";
import type {
  DhModel,
  JointKind,
  JointMap,
  MeasurementSet,
  MeasurementSetSummary,
  Robot,
  RunSummary,
} from "../api/types";
import { alike, DataTable } from "../components/table";
import { dayText, fixed } from "../lib/format";
import { degrees, position, positionUnit } from "../lib/stiffness";
import { text } from "../i18n";
import { later } from "../i18n/later";
import { api, every } from "../api/client";
import {
  Button,
  LinkButton,
  MeasureLink,
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
} from "../components/basics";
import { useLoad, valueOf, type Names, namesChanged, useNames, storedRobot, storedSet } from "../state/load";
import { link, useAction } from "../state/action";
import { MOST_RUNS, runRows } from "./runs";
import { type RunColumn, RunsTable } from "./run_stiffness";
import { useState } from "preact/hooks";
import { ChangedJoints, FilterBar, type Row, Rows, chosen, useFilter, StoredActions } from "../components/list";
import { TextField } from "../components/fields";
import { factsOf, notedIn, type Typed, typedOf, wasMeasured } from "../lib/campaign";
import { MetadataForm } from "../components/schema_form";
import { Preview } from "../components/findings";
import { Arm } from "../scene/view";

const words = later.robots;

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
            rows && slides ? `${i + 1}, ${words.kinds[kind]}` : rows ? String(i + 1) : name,
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

async function twinsOf(robot: Robot, names: Names, signal: AbortSignal): Promise<RunColumn[]> {
  const alike = names.robots.filter(({ content_hash: hash }) => hash === robot.content_hash).slice(0, MOST);
  const sets = new Map(names.sets.map((set) => [set.id, set]));
  const runs = alike.map(({ id }) => every(api.runs.list, { robot_id: id, state: "succeeded" }, 100, signal));
  const newest = newestOf((await Promise.all(runs)).flat(), sets).slice(0, MOST);
  return Promise.all(
    newest.map(async ({ id, robot_id: of, measurement_set_id: setId, created_at: created }) => {
      const set = sets.get(setId);
      const encoders = set && text.files.encoders[set.encoders];
      const note = [set?.serial_number, dayText(set?.measured_at ?? created), encoders].filter(Boolean).join(", ");
      return { run: await api.runs.one(id, signal), name: names.robot(of), note };
    }),
  );
}

/** Nothing, while there is only one robot of the kind. */
function Twins({ robot, names }: { robot: Robot; names: Names }) {
  const twins = valueOf(useLoad((signal) => twinsOf(robot, names, signal), [robot.id, names])) ?? [];
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

export function RobotsView({ list }: { list: "robots" | "sets" }) {
  const title = list === "robots" ? text.app.robots : words.sets;
  const names = useNames();
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
      <Show of={names}>{(known) => <Stored key={list} list={list} names={known} />}</Show>
    </>
  );
}

/** All robots or all sets. */
function Stored({ list, names }: { list: "robots" | "sets"; names: Names }) {
  const [filter, change] = useFilter();
  const [days, setDays] = useState({ from: "", to: "" });
  const rows =
    list === "robots"
      ? names.robots.map((robot) => robotRow(robot, names))
      : names.sets.filter((set) => wasMeasured(set, days)).map((set) => setRow(set, names));
  if (names[list].length === 0) return list === "robots" ? <NoRobots /> : <NoSets />;
  const found = chosen(rows, filter);
  const day = (end: "from" | "to") => (
    <TextField
      type="date"
      label={later.metadata[end]}
      value={days[end]}
      change={(typed) => setDays({ ...days, [end]: typed })}
    />
  );
  return (
    <section class="list">
      <FilterBar filter={filter} change={change} names={list === "sets" ? names : null}>
        {list === "sets" && day("from")}
        {list === "sets" && day("to")}
      </FilterBar>
      <p class="soft" role="status">
        {text.list.count(found.length, rows.length)}
      </p>
      {found.length > 0 ? <Rows rows={found} /> : <Empty title={text.list.noMatch} hint={text.list.noMatchHint} />}
    </section>
  );
}

function robotRow(robot: Names["robots"][number], names: Names): Row {
  const sets = names.sets.filter((set) => set.robot_id === robot.id);
  const toldApart = names.robot(robot.id).slice(robot.name.length + " · ".length); // where another has its name
  const joints = toldApart || text.lists.jointCount(robot.joints.length);
  return {
    id: robot.id,
    href: link(["robots", robot.id]),
    name: robot.name,
    note: <Name>{joints + (robot.nominal_arm ? `, ${words.nominal}` : "")}</Name>,
    how: `${words.sets}: ${sets.length}`,
    at: robot.last_campaign?.at ?? null,
    standing: (
      <>
        {robot.last_campaign && <Badge verdict={robot.last_campaign.verdict} />}
        <ChangedJoints of={robot.last_campaign} />
      </>
    ),
    words: sets.map(({ serial_number: serial }) => serial),
  };
}

function setRow(set: MeasurementSetSummary, names: Names | null): Row {
  const robot = names?.robot(set.robot_id) ?? "";
  return {
    id: set.id,
    href: link(["sets", set.id]),
    name: set.name,
    note: <Name>{[robot, set.serial_number].filter(Boolean).join(", ")}</Name>,
    how: (
      <>
        {text.sets.observations(set.observation_count)}
        <small>{text.files.encoders[set.encoders]}</small>
      </>
    ),
    at: set.measured_at ?? set.created_at,
    standing: set.warning_count > 0 && <span class="state warn">{text.files.findings(set.warning_count)}</span>,
    robot: set.robot_id,
    words: [robot, set.serial_number, set.operator, set.instrument],
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

function useRunsOf(filter: { robot_id?: string; measurement_set_id?: string }) {
  return useLoad((signal) => every(api.runs.list, filter, 100, signal), [filter.robot_id, filter.measurement_set_id]);
}

/** Robots, their sets, their geometries, and fleets of them: four lists of one section. */
export function RobotTabs({ current }: { current: "robots" | "sets" | "geometries" | "fleets" }) {
  return (
    <Tabs
      label={words.tabs}
      current={current}
      tabs={[
        { id: "robots", label: text.app.robots, href: "#/robots" },
        { id: "sets", label: words.sets, href: "#/sets" },
        { id: "geometries", label: later.geometry.title, href: "#/geometries" },
        { id: "fleets", label: later.fleet.title, href: "#/fleets" },
      ]}
    />
  );
}

export function RobotView({ id }: { id: string }) {
  const loaded = useLoad(() => storedRobot(id), [id]);
  return (
    <Show of={loaded} title={text.start.robot} restore={() => api.robots.restore(id)}>
      {(robot) => <RobotPage robot={robot} changed={loaded.reload} />}
    </Show>
  );
}

function RobotPage({ robot, changed }: { robot: Robot; changed: () => void }) {
  const names = valueOf(useNames());
  const runs = valueOf(useRunsOf({ robot_id: robot.id }));
  const sets = names?.sets.filter((set) => set.robot_id === robot.id) ?? [];
  const [filter, change] = useFilter();
  const rows = [...sets.map((set) => setRow(set, names)), ...runRows(runs ?? [], names)];
  return (
    <>
      <Head
        kind={text.start.robot}
        plain={robot.name}
        title={<Name>{robot.name}</Name>}
        about={
          <>
            <span>{text.lists.jointCount(robot.joints.length)}</span>
            {names && <span>{words.setCount(sets.length)}</span>}
            <a href={link(["compare", "trend", robot.id])}>{words.trend}</a>
          </>
        }
        first={
          <LinkButton look="primary" href={link([], { robot: robot.id })}>
            {text.app.measure}
          </LinkButton>
        }
      >
        <LinkButton href={link(["measure"], { robot: robot.id })}>{later.measure.title}</LinkButton>
        <LinkButton href={link(["plans"], { robot: robot.id })}>{later.plan.begin}</LinkButton>
        <StoredActions of={robot} api={api.robots} list="#/robots" changed={changed} />
      </Head>
      {robot.last_campaign && robot.last_campaign.changed.length > 0 && (
        <p class="note bad">
          <ChangedJoints of={robot.last_campaign} />
        </p>
      )}
      <div class="flow">
        <section class="card">
          <Arm source={{ robot_id: robot.id }} start={null} />
        </section>
        <section class="card">
          <h2>{words.facts}</h2>
          <Kinematics robot={robot} />
        </section>
      </div>
      {names && <Twins robot={robot} names={names} />}
      <section class="list">
        <h2>{words.listOf}</h2>
        {rows.length > 0 ? (
          <>
            <FilterBar filter={filter} change={change} judged />
            <Rows rows={chosen(rows, filter)} />
          </>
        ) : (
          <Empty title={words.setsNone} hint={words.setsNoneHint} />
        )}
      </section>
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
              robot.model.format === "dh" ? `${words.dh}, ${words.conventions[robot.model.convention]}` : words.urdf,
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
  const loaded = useLoad(() => storedSet(id), [id]);
  return (
    <Show of={loaded} title={text.sets.kind} restore={() => api.sets.restore(id)}>
      {(set) => <SetPage set={set} changed={loaded.reload} />}
    </Show>
  );
}

function SetPage({ set, changed }: { set: MeasurementSet; changed: () => void }) {
  const names = valueOf(useNames());
  const runs = valueOf(useRunsOf({ measurement_set_id: set.id }));
  return (
    <>
      <Head
        kind={text.sets.kind}
        plain={set.name}
        title={<Name>{set.name}</Name>}
        about={
          <>
            <NameLink to={["robots", set.robot_id]}>{names?.robot(set.robot_id) ?? "…"}</NameLink>
            <span>{text.sets.observations(set.observations.length)}</span>
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
        <LinkButton href={link(["plans"], { set: set.id })}>{later.plan.goOn}</LinkButton>
        <StoredActions of={set} api={api.sets} list="#/sets" changed={changed} />
      </Head>
      <div class="flow">
        <section class="card">
          <h2>{text.files.understood}</h2>
          <Preview facts={factsOf(set as never)} />
        </section>
        <SetMetadata set={set} changed={changed} />
        <section class="card">
          <h2>{text.sets.findings}</h2>
          {set.warnings.length > 0 ? <Warnings warnings={set.warnings} /> : <p class="note good">{text.files.clean}</p>}
        </section>
      </div>
      {runs && runs.length > 0 && (
        <section>
          <h2>{text.sets.runs}</h2>
          <Rows rows={runRows(runs, names)} />
        </section>
      )}
    </>
  );
}

/** What people noted about a set, and the form to change it: the readings stay as they are. */
export function SetMetadata({ set, changed }: { set: MeasurementSet; changed: () => void }) {
  const words = later.metadata;
  /** What is typed; null while nothing is changed. */
  const [typed, setTyped] = useState<Typed | null>(null);
  const noted = typed && notedIn(typed);
  const save = useAction(async () => {
    if (!noted) return;
    await api.sets.change(set.id, noted);
    namesChanged();
    setTyped(null);
    changed();
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
