/** Lists of robots and of measurement sets. */
import { api, every } from "../api/client";
import { Empty, Name, Show, Title, When } from "../components/basics";
import { RobotTabs } from "../components/robot_tabs";
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
          <a class="button primary" href="#/robots/new">
            {text.robots.add}
          </a>
        </div>
      </div>
      <RobotTabs current={list} />
      <Show of={names}>{(known) => (list === "robots" ? <Robots names={known} /> : <Sets names={known} />)}</Show>
    </>
  );
}

function Robots({ names: { robots, sets } }: { names: Names }) {
  if (robots.length === 0) {
    return (
      <Empty title={text.robots.none} hint={text.robots.noneHint}>
        <a class="button primary" href="#/robots/new">
          {text.robots.add}
        </a>
      </Empty>
    );
  }
  return (
    <ul class="rows">
      {robots.map((robot) => (
        <li class="item">
          <a class="main" href={link(["robots", robot.id])}>
            <span class="what">
              <Name>{robot.name}</Name>
              <small>{text.robots.joints(robot.joints.length)}</small>
            </span>
            <span class="how">
              {text.robots.sets}: {sets.filter((set) => set.robot_id === robot.id).length}
            </span>
            <span class="when">
              <When time={robot.created_at} />
            </span>
          </a>
        </li>
      ))}
    </ul>
  );
}

function Sets({ names }: { names: Names }) {
  if (names.sets.length === 0) {
    return (
      <Empty title={text.robots.setsNone} hint={text.robots.setsNoneHint}>
        <a class="button primary" href="#/">
          {text.app.measure}
        </a>
      </Empty>
    );
  }
  return <SetList names={names} sets={names.sets} />;
}

export function SetList({ names, sets }: { names: Names | null; sets: Names["sets"] }) {
  return (
    <ul class="rows">
      {sets.map((set) => (
        <li class="item">
          <a class="main" href={link(["sets", set.id])}>
            <span class="what">
              <Name>{set.name}</Name>
              <small>
                <Name>{names?.robot(set.robot_id) ?? ""}</Name>
              </small>
            </span>
            <span class="how">
              {text.sets.observations(set.observation_count)}
              <small>{text.files.encoders[set.encoders]}</small>
            </span>
            <span class="when">
              <When time={set.created_at} />
            </span>
            <span class="standing">
              {set.warning_count > 0 && <span class="state warn">{text.sets.warnings(set.warning_count)}</span>}
            </span>
          </a>
        </li>
      ))}
    </ul>
  );
}

export function useRunsOf(filter: { robot_id?: string; measurement_set_id?: string }) {
  return useLoad((signal) => every(api.runs, filter, 100, signal), [filter.robot_id, filter.measurement_set_id]);
}
