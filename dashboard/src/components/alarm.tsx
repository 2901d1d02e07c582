/** Alarms of robots that nobody has acknowledged, where the robots and their runs are shown. */
import type { OpenAlarm } from "../api/types";
import { changeText } from "../lib/trend";
import { link } from "../state/router";
import { text } from "../i18n";
import { dayText, Name } from "./basics";

/** Joint and change, for lists. */
export function AlarmState({ alarms }: { alarms: OpenAlarm[] }) {
  const [first] = alarms;
  if (!first) return null;
  return (
    <>
      <span class="state alarm">{text.fleet.states.alarm}</span>
      <small>
        <Name>{first.joint}</Name> {changeText(first.change)}
        {alarms.length > 1 && ` ${text.alarms.more(alarms.length - 1)}`}
      </small>
    </>
  );
}

/** All of a robot with the way to its trend, where they are acknowledged. */
export function AlarmNote({ robot, name, alarms }: { robot: string; name?: string; alarms: OpenAlarm[] }) {
  if (alarms.length === 0) return null;
  return (
    <p class="note bad alarms">
      <b class="state alarm">{name === undefined ? text.alarms.this : text.alarms.of(name)}</b>{" "}
      {alarms.map(({ serial_number: serial, joint, change, since }, index) => (
        <>
          {index > 0 && "; "}
          <a href={link(["compare", "trend", robot], serial === null ? {} : { serial })}>
            <Name>{serial === null ? joint : `${serial}, ${joint}`}</Name> {changeText(change)}{" "}
            {text.alarms.since(dayText(since))}
          </a>
        </>
      ))}
    </p>
  );
}
