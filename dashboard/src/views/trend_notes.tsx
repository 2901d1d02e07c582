/** What people note in a trend: alarms that were seen, and new baselines. */
import { useState } from "preact/hooks";
import { api } from "../api/client";
import type { Trend, TrendAlarm } from "../api/types";
import { Button, dayText, Form, Name, When } from "../components/basics";
import { TextField, Select } from "../components/fields";
import { changedTogether } from "../lib/trend";
import { useAction } from "../state/action";
import { namesChanged } from "../state/names";
import { link } from "../state/router";
import { later } from "../i18n/later";

const words = later.trend;
const [LEAST, MOST] = [3, 20];

interface Noted {
  trend: Trend;
  reload: () => void;
}

interface Raised {
  joint: string;
  alarm: TrendAlarm;
}

/** Alarms that last, each with its reason and who has seen it; those that ended are folded away. */
export function Alarms({ trend, reload }: Noted) {
  const raised = trend.joints.flatMap(({ name, alarms }) => alarms.map((alarm) => ({ joint: name, alarm })));
  const lasting = raised.filter(({ alarm }) => alarm.until === null);
  const ended = raised.filter(({ alarm }) => alarm.until !== null);
  const shown = (one: Raised) => (
    <Alarm key={`${one.joint}/${one.alarm.run_id}`} robot={trend.robot_id} raised={one} reload={reload} />
  );
  return (
    <>
      {changedTogether(trend.joints) && <p class="note warn">{words.together}</p>}
      {lasting.map(shown)}
      {ended.length > 0 && (
        <details>
          <summary>{words.ended(ended.length)}</summary>
          {ended.map(shown)}
        </details>
      )}
    </>
  );
}

function Alarm({ robot, raised: { joint, alarm }, reload }: { robot: string; raised: Raised; reload: () => void }) {
  const seen = alarm.acknowledgement;
  const [note, setNote] = useState("");
  const send = useAction(async () => {
    await api.acknowledge(robot, { run_id: alarm.run_id, joint, note: note.trim() });
    namesChanged();
    reload();
  });
  return (
    <section class={seen || alarm.until !== null ? "note warn" : "note bad"} aria-label={words.alarmOf(joint)}>
      <p>
        <b>{alarm.message}</b>
      </p>
      <p>
        <a href={link(["runs", alarm.run_id])}>{words.firstRun}</a>
        {alarm.until !== null && (
          <>
            {" "}
            {words.until} <When time={alarm.until} />
          </>
        )}
      </p>
      {seen ? (
        <p>
          {words.seen(seen.acknowledged_by?.key_name ?? null)} <When time={seen.acknowledged_at} />:{" "}
          <Name>{seen.note}</Name>
        </p>
      ) : (
        <Form action={send}>
          <TextField label={words.note} required maxLength={2000} value={note} change={setNote} />
          <Button acts type="submit" disabled={send.busy || note.trim() === ""}>
            {words.acknowledge}
          </Button>
        </Form>
      )}
    </section>
  );
}

/** A new baseline from a campaign on, with its reason. */
export function NewBaseline({ trend, reload }: Noted) {
  const [run, setRun] = useState(trend.campaigns.at(-1)?.run_id ?? "");
  const [reason, setReason] = useState("");
  const [size, setSize] = useState(LEAST);
  const send = useAction(async () => {
    await api.addBaseline(trend.robot_id, { run_id: run, reason: reason.trim(), campaigns: size });
    reload();
  });
  return (
    <details class="baselines">
      <summary>{words.baselines(trend.baselines.length)}</summary>
      <ul>
        {trend.baselines.map(({ starts_at: start, reason: why, campaigns, set_by: by }) => (
          <li>
            <When time={start} />: <Name>{why ?? words.firstCampaigns}</Name> ({words.takes(campaigns)}
            {by ? `, ${by.key_name}` : ""})
          </li>
        ))}
      </ul>
      <Form action={send}>
        <Select
          label={words.from}
          value={run}
          change={setRun}
          options={trend.campaigns.map(({ run_id: value, name, at }) => ({ value, label: `${dayText(at)}, ${name}` }))}
        />
        <TextField
          label={words.reason}
          required
          maxLength={200}
          placeholder={words.reasonExample}
          value={reason}
          change={setReason}
        />
        <TextField
          label={words.size}
          type="number"
          min={LEAST}
          max={MOST}
          value={String(size)}
          change={(typed) => setSize(Number(typed))}
        />
        <Button acts type="submit" disabled={send.busy || reason.trim() === ""}>
          {words.begin}
        </Button>
      </Form>
    </details>
  );
}
