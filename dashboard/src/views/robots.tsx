/** Lists of robots and of measurement sets. */
import { useState } from "preact/hooks";
import type { MeasurementSetSummary } from "../api/types";
import { api, every } from "../api/client";
import { AlarmState } from "../components/alarm";
import { Empty, Head, LinkButton, Name, Show, Tabs, Toggle } from "../components/basics";
import { TextField } from "../components/fields";
import { FilterBar, type Row, Rows, chosen, useFilter } from "../components/list";
import { wasMeasured } from "../lib/metadata";
import { type Names, useNames } from "../state/names";
import { useLoad } from "../state/load";
import { link } from "../state/router";
import { text } from "../i18n";
import { later } from "../i18n/later";

const words = later.robots;

export function RobotsView({ list }: { list: "robots" | "sets" }) {
  const title = list === "robots" ? words.title : words.sets;
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

/** All robots or all sets; what lists leave out, on demand. */
function Stored({ list, names }: { list: "robots" | "sets"; names: Names }) {
  const [filter, change] = useFilter();
  const [archived, setArchived] = useState(false);
  const [days, setDays] = useState({ from: "", to: "" });
  const from = archived ? names.archived : names;
  const rows =
    list === "robots"
      ? from.robots.map((robot) => robotRow(robot, names))
      : from.sets.filter((set) => wasMeasured(set, days)).map((set) => setRow(set, names));
  if (names[list].length + names.archived[list].length === 0) return list === "robots" ? <NoRobots /> : <NoSets />;
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
        {(names.archived[list].length > 0 || archived) && (
          <Toggle label={text.changes.showArchived} checked={archived} change={setArchived} />
        )}
      </FilterBar>
      <p class="soft" role="status">
        {text.list.count(found.length, rows.length)}
      </p>
      {found.length > 0 ? (
        <Rows rows={found} />
      ) : archived && from[list].length === 0 ? (
        <Empty title={text.changes.noneArchived} hint={text.changes.archiveHint} />
      ) : (
        <Empty title={text.list.noMatch} hint={text.list.noMatchHint} />
      )}
    </section>
  );
}

function robotRow(robot: Names["robots"][number], names: Names): Row {
  const sets = [...names.sets, ...names.archived.sets].filter((set) => set.robot_id === robot.id);
  const toldApart = names.robot(robot.id).slice(robot.name.length); // serial number and date, where another has its name
  const joints = text.lists.jointCount(robot.joints.length) + (robot.nominal_arm ? `, ${words.nominal}` : "");
  return {
    id: robot.id,
    href: link(["robots", robot.id]),
    name: robot.name,
    what: <Name>{robot.name}</Name>,
    note: <Name>{joints + toldApart}</Name>,
    how: `${words.sets}: ${sets.length}`,
    at: robot.created_at,
    standing: robot.alarms.length > 0 && <AlarmState alarms={robot.alarms} />,
    words: sets.map(({ serial_number: serial }) => serial),
  };
}

export function setRow(set: MeasurementSetSummary, names: Names | null): Row {
  const robot = names?.robot(set.robot_id) ?? "";
  return {
    id: set.id,
    href: link(["sets", set.id]),
    name: set.name,
    what: <Name>{set.name}</Name>,
    note: <Name>{[robot, set.serial_number].filter(Boolean).join(", ")}</Name>,
    how: (
      <>
        {text.sets.observations(set.observation_count)}
        <small>{text.files.encoders[set.encoders]}</small>
      </>
    ),
    at: set.measured_at ?? set.created_at,
    standing: set.warning_count > 0 && <span class="state warn">{text.sets.warnings(set.warning_count)}</span>,
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

const NoSets = () => (
  <Empty title={words.setsNone} hint={words.setsNoneHint}>
    <LinkButton look="primary" href="#/">
      {text.app.measure}
    </LinkButton>
  </Empty>
);

export function useRunsOf(filter: { robot_id?: string; measurement_set_id?: string }) {
  return useLoad((signal) => every(api.runs.list, filter, 100, signal), [filter.robot_id, filter.measurement_set_id]);
}

/** Robots, their sets and their geometries: three lists of one section. */
export function RobotTabs({ current }: { current: "robots" | "sets" | "geometries" | "fleet" }) {
  return (
    <Tabs
      label={later.robots.tabs}
      current={current}
      tabs={[
        { id: "robots", label: later.robots.title, href: "#/robots" },
        { id: "sets", label: later.robots.sets, href: "#/sets" },
        { id: "geometries", label: later.geometry.title, href: "#/geometries" },
        { id: "fleet", label: text.fleet.title, href: "#/fleet" },
      ]}
    />
  );
}
