/** Lists of robots and of measurement sets. */
import type { ComponentChild } from "preact";
import { useState } from "preact/hooks";
import { api, every } from "../api/client";
import { Empty, LinkButton, Name, Show, Title, Toggle, When } from "../components/basics";
import { TextField } from "../components/fields";
import { Item } from "../components/item";
import { RobotTabs } from "../components/robot_tabs";
import { matches, type SetFilter } from "../lib/metadata";
import { type Names, useNames } from "../state/names";
import { useLoad } from "../state/load";
import { link } from "../state/router";
import { text } from "../i18n";

export function RobotsView({ list }: { list: "robots" | "sets" }) {
  const title = list === "robots" ? text.robots.title : text.robots.sets;
  const names = useNames();
  return (
    <>
      <div class="head">
        <Title plain={title}>{title}</Title>
        <div class="actions">
          <LinkButton look="primary" href="#/robots/new">
            {text.robots.add}
          </LinkButton>
        </div>
      </div>
      <RobotTabs current={list} />
      <Show of={names}>{(known) => (list === "robots" ? <Robots names={known} /> : <Sets names={known} />)}</Show>
    </>
  );
}

/** What lists leave out, on demand. */
function useArchived(kept: unknown[]): [boolean, ComponentChild] {
  const [archived, set] = useState(false);
  const words = text.changes;
  const toggle = (kept.length > 0 || archived) && <Toggle label={words.showArchived} checked={archived} change={set} />;
  return [archived, toggle];
}

const NothingArchived = () => <Empty title={text.changes.noneArchived} hint={text.changes.archiveHint} />;

function Robots({ names }: { names: Names }) {
  const [archived, toggle] = useArchived(names.archived.robots);
  const robots = archived ? names.archived.robots : names.robots;
  const sets = [...names.sets, ...names.archived.sets];
  return (
    <>
      {toggle}
      {robots.length > 0 ? (
        <ul class="rows">
          {robots.map((robot) => (
            <Item
              href={link(["robots", robot.id])}
              what={<Name>{robot.name}</Name>}
              note={text.robots.joints(robot.joints.length) + (robot.nominal_arm ? `, ${text.robots.nominal}` : "")}
              how={`${text.robots.sets}: ${sets.filter((set) => set.robot_id === robot.id).length}`}
              when={<When time={robot.created_at} />}
            />
          ))}
        </ul>
      ) : archived ? (
        <NothingArchived />
      ) : (
        <NoRobots />
      )}
    </>
  );
}

/** There is no robot yet, and how to add one. */
export const NoRobots = () => (
  <Empty title={text.robots.none} hint={text.robots.noneHint}>
    <LinkButton look="primary" href="#/robots/new">
      {text.robots.add}
    </LinkButton>
  </Empty>
);

function Sets({ names }: { names: Names }) {
  const [archived, toggle] = useArchived(names.archived.sets);
  const [filter, setFilter] = useState<SetFilter>({ words: "", from: "", to: "" });
  const sets = archived ? names.archived.sets : names.sets;
  if (names.sets.length === 0 && names.archived.sets.length === 0) {
    return (
      <Empty title={text.robots.setsNone} hint={text.robots.setsNoneHint}>
        <LinkButton look="primary" href="#/">
          {text.app.measure}
        </LinkButton>
      </Empty>
    );
  }
  const found = sets.filter((set) => matches(set, filter));
  return (
    <>
      <FilterRow filter={filter} change={setFilter} />
      {toggle}
      {found.length > 0 ? (
        <SetList names={names} sets={found} />
      ) : archived && sets.length === 0 ? (
        <NothingArchived />
      ) : (
        <Empty title={text.metadata.noMatch} hint={text.metadata.noMatchHint} />
      )}
    </>
  );
}

function FilterRow({ filter, change }: { filter: SetFilter; change: (filter: SetFilter) => void }) {
  const words = text.metadata;
  const field = (name: keyof SetFilter, label: string, type: "search" | "date") => (
    <TextField
      label={label}
      type={type}
      value={filter[name]}
      placeholder={name === "words" ? words.filterPlaceholder : ""}
      change={(typed) => change({ ...filter, [name]: typed })}
    />
  );
  return (
    <div class="row">
      {field("words", words.filter, "search")}
      {field("from", words.from, "date")}
      {field("to", words.to, "date")}
    </div>
  );
}

export function SetList({ names, sets }: { names: Names | null; sets: Names["sets"] }) {
  return (
    <ul class="rows">
      {sets.map((set) => (
        <Item
          href={link(["sets", set.id])}
          what={<Name>{set.name}</Name>}
          note={
            <>
              <Name>{names?.robot(set.robot_id) ?? ""}</Name>
              {set.serial_number && ", "}
              {set.serial_number && <Name>{set.serial_number}</Name>}
            </>
          }
          how={
            <>
              {text.sets.observations(set.observation_count)}
              <small>{text.files.encoders[set.encoders]}</small>
            </>
          }
          when={<When time={set.measured_at ?? set.created_at} />}
          standing={set.warning_count > 0 && <span class="state warn">{text.sets.warnings(set.warning_count)}</span>}
        />
      ))}
    </ul>
  );
}

export function useRunsOf(filter: { robot_id?: string; measurement_set_id?: string }) {
  return useLoad((signal) => every(api.runs.list, filter, 100, signal), [filter.robot_id, filter.measurement_set_id]);
}
