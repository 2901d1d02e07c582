/** All robots at a glance: one row a robot and serial number, its worst joint, those in alarm first. */
import { api } from "../api/client";
import type { FleetRow } from "../api/types";
import { Badge, Name, Show, Title } from "../components/basics";
import { type Row, Rows } from "../components/list";
import { changeText } from "../lib/trend";
import { useLoad } from "../state/load";
import { link } from "../state/router";
import { text } from "../i18n";
import { NoRobots, RobotTabs } from "./robots";

const words = text.fleet;

export function FleetView() {
  const fleet = useLoad((signal) => api.fleet(signal), []);
  return (
    <>
      <Title plain={words.title}>{words.title}</Title>
      <RobotTabs current="fleet" />
      <Show of={fleet}>
        {({ items, is_whole: whole }) =>
          items.length === 0 ? (
            <NoRobots />
          ) : (
            <>
              {!whole && <p class="note">{words.some}</p>}
              <div class="fleet">
                <Rows rows={items.map(rowOf)} />
              </div>
            </>
          )
        }
      </Show>
    </>
  );
}

export function rowOf(row: FleetRow): Row {
  const query = row.serial_number === null ? {} : { serial: row.serial_number };
  const note = row.alarm ?? (row.change && row.missing);
  return {
    id: `${row.robot_id}/${row.serial_number}`,
    href: link(["compare", "trend", row.robot_id], query),
    name: row.name,
    what: <Name>{row.name}</Name>,
    note: row.serial_number === null ? words.noSerial : <Name>{row.serial_number}</Name>,
    how: (
      <>
        {row.joint && row.change ? words.latest(row.joint, changeText(row.change)) : (row.missing ?? "")}
        {note && <small>{note}</small>}
      </>
    ),
    at: row.measured_at,
    since: words.campaigns(row.campaigns),
    standing: (
      <>
        <span class={`state ${row.state}`}>{words.states[row.state]}</span>
        {row.verdict && <Badge verdict={row.verdict} />}
      </>
    ),
  };
}
