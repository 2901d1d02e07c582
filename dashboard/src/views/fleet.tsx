/** All robots at a glance: one row a robot and serial number, its worst joint, those in alarm first. */
import { api } from "../api/client";
import type { FleetRow } from "../api/types";
import { Name, Show, Title, When } from "../components/basics";
import { Item } from "../components/item";
import { RobotTabs } from "../components/robot_tabs";
import { changeText } from "../lib/trend";
import { useLoad } from "../state/load";
import { link } from "../state/router";
import { text } from "../i18n";
import { NoRobots } from "./robots";

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
              <ul class="rows fleet">
                {items.map((row) => (
                  <Row key={`${row.robot_id}/${row.serial_number}`} row={row} />
                ))}
              </ul>
            </>
          )
        }
      </Show>
    </>
  );
}

export function Row({ row }: { row: FleetRow }) {
  const query = row.serial_number === null ? {} : { serial: row.serial_number };
  return (
    <Item
      href={link(["compare", "trend", row.robot_id], query)}
      what={<Name>{row.name}</Name>}
      note={row.serial_number === null ? words.noSerial : <Name>{row.serial_number}</Name>}
      how={
        <>
          {row.joint && row.change ? words.latest(row.joint, changeText(row.change)) : (row.missing ?? "")}
          {row.alarm !== null ? <small>{row.alarm}</small> : row.change && row.missing && <small>{row.missing}</small>}
        </>
      }
      when={
        <>
          {row.measured_at === null ? words.never : <When time={row.measured_at} />}
          <small>{words.campaigns(row.campaigns)}</small>
        </>
      }
      standing={<span class={`state ${row.state}`}>{words.states[row.state]}</span>}
    />
  );
}
