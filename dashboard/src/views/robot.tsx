/** One robot: drawn, as it was understood, with its sets, runs and trend. */
import type { JointKind, Robot } from "../api/types";
import { api } from "../api/client";
import { AlarmNote } from "../components/alarm";
import { Arm } from "../components/arm";
import { StoredActions } from "../components/changes";
import { Empty, Facts, Head, LinkButton, Name, Show } from "../components/basics";
import { chosen, FilterBar, Rows, useFilter } from "../components/list";
import { alike, DataTable } from "../components/table";
import { fixed } from "../lib/format";
import { position, positionUnit } from "../lib/units";
import { useLoad, valueOf } from "../state/load";
import { useNames, storedRobot } from "../state/names";
import { link } from "../state/router";
import { text } from "../i18n";
import { later } from "../i18n/later";
import { JointMapTable, RowsTable } from "./robot_tables";
import { Twins } from "./robot_twins";
import { setRow, useRunsOf } from "./robots";
import { runRows } from "./runs";

export function RobotView({ id }: { id: string }) {
  const loaded = useLoad(() => storedRobot(id), [id]);
  return (
    <Show of={loaded} title={text.start.robot}>
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
            {names && <span>{later.robots.setCount(sets.length)}</span>}
            {robot.archived && <span>{text.changes.archived}</span>}
          </>
        }
        first={
          <LinkButton look="primary" href={link([], { robot: robot.id })}>
            {later.robots.use}
          </LinkButton>
        }
      >
        <LinkButton href={link(["measure"], { robot: robot.id })}>{later.measure.title}</LinkButton>
        <LinkButton href={link(["plans"], { robot: robot.id })}>{later.plan.begin}</LinkButton>
        <LinkButton href={link(["compare", "trend", robot.id])}>{later.robots.trend}</LinkButton>
        <StoredActions of={robot} api={api.robots} list="#/robots" changed={changed} />
      </Head>
      <AlarmNote robot={robot.id} alarms={names?.robots.find(({ id }) => id === robot.id)?.alarms ?? robot.alarms} />
      <div class="flow">
        <section class="card">
          <Arm source={{ robot_id: robot.id }} start={null} />
        </section>
        <section class="card">
          <h2>{later.robots.facts}</h2>
          <Kinematics robot={robot} />
        </section>
      </div>
      <Twins robot={robot} />
      <section class="list">
        <h2>{later.robots.listOf}</h2>
        {rows.length > 0 ? (
          <>
            <FilterBar filter={filter} change={change} judged />
            <Rows rows={chosen(rows, filter)} />
          </>
        ) : (
          <Empty title={later.robots.setsNone} hint={later.robots.setsNoneHint} />
        )}
      </section>
    </>
  );
}

function Kinematics({ robot }: { robot: Robot }) {
  const { wrist } = robot;
  const miss = wrist.miss_distance;
  const words = later.robots;
  const limit = (value: number | null, kind: JointKind) =>
    value === null ? words.unlimited : `${fixed(position(value, kind), 0)}${slides ? positionUnit(kind) : ""}`;
  const slides = robot.joints.some(({ kind }) => kind === "prismatic");
  return (
    <>
      {robot.nominal_arm && <p class="note warn">{words.nominalNote}</p>}
      <Facts
        facts={[
          ...(robot.nominal_arm ? [{ label: words.nominalArm, value: <Name>{robot.nominal_arm}</Name> }] : []),
          {
            label: words.description,
            value:
              robot.model.format === "dh" ? `${words.dh}, ${words.conventions[robot.model.convention]}` : words.urdf,
          },
          {
            label: words.wrist,
            value: wrist.spherical
              ? words.spherical
              : miss === null
                ? words.noCentre
                : words.notSpherical(`${fixed(miss * 1e3, 2)} ${text.units.mm}`),
          },
          ...(robot.joint_map ? [] : [{ label: words.map, value: words.identity }]),
        ]}
      />
      {robot.model.format === "dh" && <RowsTable model={robot.model} />}
      {robot.joint_map && (
        <>
          <h3>{words.map}</h3>
          <JointMapTable map={robot.joint_map} kinds={robot.joints.map(({ kind }) => kind)} />
        </>
      )}
      {robot.model.format === "urdf" && (
        <DataTable
          caption={words.limits}
          table={{
            columns: [
              text.run.joint,
              ...(slides ? [words.lower, words.upper] : alike([words.lower, words.upper], text.units.deg)),
            ],
            rows: robot.joints.map(({ name, kind, lower, upper }) => [name, limit(lower, kind), limit(upper, kind)]),
          }}
        />
      )}
    </>
  );
}
