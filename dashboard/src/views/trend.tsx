/** Each joint of one robot over its campaigns: charts against a baseline, alarms, and new baselines. */
import { significant, pValue, extent, logarithmic } from "../lib/format";
import { dayText, tip, Button, Form, Name, When, Badge, Empty, Head, LinkButton, Show } from "../components/basics";
import { go, useAction, link } from "../state/action";
import { LeftAxis, Chart, Figure, Legend } from "../charts/figure";
import { useState } from "preact/hooks";
import { api } from "../api/client";
import type { Trend, TrendAlarm, Method, Robot, Trend as Found, TrendJoint } from "../api/types";
import { TextField, Select } from "../components/fields";
import { changedTogether, bandsOf, changeText, pointsOf, worstFirst } from "../lib/trend";
import { namesChanged, useLoad, storedRobot } from "../state/load";
import { later } from "../i18n/later";
import { alike } from "../components/table";
import { Rows } from "../components/list";
import { intervalIn, maybeInUnit, unitOf } from "../lib/stiffness";
import { useSettings } from "../state/session";
import { text } from "../i18n";

export interface TrendPoint {
  time: number;
  value: number | null;
  low: number | null;
  high: number | null;
  /** EWMA after this campaign and its limits; null before there are any. */
  smoothed: number | null;
  limits: [number, number] | null;
  /** Whether the EWMA is beyond a limit. */
  alarm: boolean;
  mark: string;
  title: string;
  /** Address of its run. */
  open?: string;
  /** Which baseline it belongs to: lines are drawn within one only. */
  part: number;
}

export interface TrendBand {
  part: number;
  low: number;
  high: number;
}

interface Ground {
  x: (point: TrendPoint) => number;
  y: (value: number) => number;
}

export function TrendChart({
  points,
  bands,
  width,
  height = 240,
  label,
  unit,
}: {
  points: TrendPoint[];
  bands: TrendBand[];
  width: number;
  height?: number;
  label: string;
  unit: string;
}) {
  const [left, right, bottom] = [60, width - 16, height - 34];
  const numbers = points
    .flatMap((p) => [p.value, p.low, p.high, p.smoothed, ...(p.limits ?? [])])
    .filter((v): v is number => v !== null && v > 0);
  const [low, high] = extent(numbers) ?? [1, 10];
  const room = Math.max(1.01, (high / low) ** 0.12);
  const y = logarithmic(low / room, high * room, bottom, 28, 5);
  const times = extent(points.map((p) => p.time)) ?? [0, 1];
  const ground = { x: placeIn(points, times, left + 24, right - 24), y };
  const parts = [...new Set(points.map((p) => p.part))];
  return (
    <Chart width={width} height={height} label={label} links>
      <LeftAxis
        scale={y}
        left={left}
        right={right}
        format={(v) => (v < 1e4 ? String(Number(v.toPrecision(4))) : significant(v, 3))}
        unit={unit}
      />
      {parts.map((part) => (
        <Part
          points={points.filter((p) => p.part === part)}
          band={bands.find((band) => band.part === part)}
          ground={ground}
        />
      ))}
      {points.map((point) => {
        const { low, high, value, smoothed, title, open } = point;
        if (low === null && (value === null || value <= 0)) return null;
        const x = ground.x(point);
        const end = high === null ? 28 : y(high);
        const start = low === null ? null : low > 0 ? y(low) : bottom; // zero lies below any decade
        const hidden = start !== null && start - end < 15 && value !== null;
        const link = open && {
          role: "link" as const,
          tabindex: 0, // of an SVG element: its attributes keep their case
          "aria-label": title.replaceAll("\n", ", "),
          onKeyDown: (event: KeyboardEvent) => event.key === "Enter" && go(open),
        };
        return (
          <g class={`interval ${point.mark}`} {...link} {...tip(title.split("\n"), open)}>
            <rect class="hit" x={x - 12} width={24} y={28} height={Math.max(24, bottom - 28)} />
            {start !== null && <line x1={x} x2={x} y1={start} y2={end} />}
            {start !== null && !hidden && <line class="end" x1={x - 6} x2={x + 6} y1={start} y2={start} />}
            {high !== null && low !== null && !hidden && <line class="end" x1={x - 6} x2={x + 6} y1={end} y2={end} />}
            {high === null && low !== null && <path class="head" d={`M${x} 22 l-7 13 h14 z`} />}
            {value !== null && value > 0 && <circle cx={x} cy={y(value)} r={6} />}
            {point.alarm && smoothed !== null && <path class="alarm" d={`M${x} ${y(smoothed) - 9}l9 9l-9 9l-9 -9z`} />}
          </g>
        );
      })}
      <g class="axis">
        {points.length > 0 &&
          [...new Set(times.map(dayText))].map((day, i) => (
            <text x={i ? right : left} y={bottom + 22} text-anchor={i ? "end" : "start"}>
              {day}
            </text>
          ))}
      </g>
    </Chart>
  );
}

/** What belongs to one baseline: its band, the EWMA and the limits; other campaigns have their own. */
function Part({ points, band, ground }: { points: TrendPoint[]; band: TrendBand | undefined; ground: Ground }) {
  const places = points.map(ground.x);
  const [from, to] = [Math.min(...places) - 10, Math.max(...places) + 10];
  const followed = points.filter((p) => p.limits !== null);
  const line = (value: (p: TrendPoint) => number | null | undefined) => thread(followed, value, ground);
  return (
    <g>
      {band && (
        <rect
          class="band"
          x={from}
          width={to - from}
          y={ground.y(band.high)}
          height={Math.max(1, ground.y(band.low) - ground.y(band.high))}
        />
      )}
      <path class="limit" d={line((p) => p.limits?.[0])} />
      <path class="limit" d={line((p) => p.limits?.[1])} />
      <path class="smoothed" d={line((p) => p.smoothed)} />
      {followed.length === 1 &&
        followed.flatMap((p) =>
          (p.limits ?? []).map((limit) => <path class="limit" d={`M${ground.x(p) - 8} ${ground.y(limit)}h16`} />),
        )}
    </g>
  );
}

function thread(
  points: TrendPoint[],
  value: (point: TrendPoint) => number | null | undefined,
  { x, y }: Ground,
): string {
  return points
    .flatMap((p) => {
      const found = value(p);
      return found ? [`${x(p)} ${y(found)}`] : [];
    })
    .map((place, i) => `${i ? "L" : "M"}${place}`)
    .join("");
}

/** By time, but evenly where all are so close that they would cover each other. */
function placeIn(
  points: TrendPoint[],
  [first, last]: [number, number],
  from: number,
  to: number,
): (point: TrendPoint) => number {
  const sorted = points.map((p) => p.time).sort((a, b) => a - b);
  const gap = Math.min(...sorted.slice(1).map((time, i) => time - (sorted[i] ?? 0)), Infinity);
  if (points.length < 2 || last === first)
    return (p) => from + ((points.indexOf(p) + 0.5) / points.length) * (to - from);
  const even = (gap / (last - first)) * (to - from) < 16;
  return (p) =>
    from + (even ? points.indexOf(p) / (points.length - 1) : (p.time - first) / (last - first)) * (to - from);
}

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

type Encoders = NonNullable<Found["selection"]>["encoders"];
const ENCODERS: Encoders[] = ["motor", "secondary"];
const METHODS: Method[] = ["partial_pose", "decoupled_partial_pose", "complete_pose"];

export function TrendView({ robot: id, serial }: { robot: string; serial: string | null }) {
  const [method, setMethod] = useState<Method | null>(null);
  const [encoders, setEncoders] = useState<Encoders | null>(null);
  const robot = useLoad(() => storedRobot(id), [id]);
  const asked = { method, encoders, serial_number: serial };
  const trend = useLoad((signal) => api.trend(id, asked, signal), [id, method, encoders, serial]);
  return (
    <Show of={robot} title={later.compare.trend}>
      {({ name }) => (
        <>
          <Head
            kind={later.compare.trend}
            plain={words.title(name)}
            title={<Name>{name}</Name>}
            about={
              <>
                <a href={link(["robots", id])}>{text.start.robot}</a>
                <a href={link(["fleet"])}>{text.fleet.title}</a>
              </>
            }
          />
          <Show of={trend}>
            {(found) => (
              <>
                <div class="filters compact">
                  <Select
                    label={text.run.method}
                    value={method ?? found.selection?.method ?? "partial_pose"}
                    change={(chosen) => setMethod(chosen as Method)}
                    options={METHODS.map((value) => ({ value, label: text.methods[value] }))}
                  />
                  <Select
                    label={words.encoders}
                    value={encoders ?? found.selection?.encoders ?? "motor"}
                    change={(chosen) => setEncoders(chosen as Encoders)}
                    options={ENCODERS.map((value) => ({ value, label: text.files.encoders[value] }))}
                  />
                  {serialsOf(found).length > 1 && (
                    <Select
                      label={words.serial}
                      value={found.selection?.serial_number ?? ""}
                      change={(chosen) => go(link(["compare", "trend", id], { serial: chosen }))}
                      options={serialsOf(found)}
                    />
                  )}
                </div>
                <Charts robot={id} trend={found} reload={trend.reload} />
              </>
            )}
          </Show>
        </>
      )}
    </Show>
  );
}

/** The serial numbers of the robot's sets, and that the chart shown is of sets without one. */
const serialsOf = ({ selection, serial_numbers: serials }: Found) => [
  ...(selection?.serial_number ? [] : [{ value: "", label: text.fleet.noSerial }]),
  ...serials.map((value) => ({ value, label: value })),
];

function Charts({ robot, trend, reload }: { robot: Robot["id"]; trend: Found; reload: () => void }) {
  if (trend.campaigns.length === 0) {
    return (
      <>
        <Empty title={words.none} hint={words.noneHint}>
          <LinkButton look="primary" href={link([], { robot })}>
            {text.app.measure}
          </LinkButton>
        </Empty>
        <LeftOut trend={trend} />
      </>
    );
  }
  return (
    <>
      {trend.note !== null && <p class="note">{words.notYet(trend.note)}</p>}
      <Alarms trend={trend} reload={reload} />
      <p class="hint">{words.rate(trend.false_alarms)}</p>
      <Legend
        items={[
          { label: words.campaign, mark: "method-1" },
          { label: words.inBaseline, mark: "free" },
          { label: words.smoothed, mark: "smoothed" },
          { label: words.limits, mark: "limit" },
          { label: words.band, mark: "band" },
          { label: words.alarm, mark: "alarm" },
        ]}
      />
      <div class="multiples">
        {worstFirst(trend.joints).map((joint) => (
          <JointTrend key={joint.name} joint={joint} trend={trend} />
        ))}
      </div>
      <details open={trend.campaigns.some(({ assessment }) => assessment.verdict !== "use")}>
        <summary>{words.takes(trend.campaigns.length)}</summary>
        <Rows
          rows={trend.campaigns.map(({ run_id: id, name, at, assessment }) => ({
            id,
            href: link(["runs", id]),
            name,
            what: <Name>{name}</Name>,
            at,
            standing: <Badge verdict={assessment.verdict} />,
          }))}
        />
      </details>
      <NewBaseline trend={trend} reload={reload} />
      <LeftOut trend={trend} />
    </>
  );
}

function JointTrend({ joint, trend }: { joint: TrendJoint; trend: Found }) {
  const { unit } = useSettings();
  const { label, column } = unitOf(unit, joint.kind);
  const points = pointsOf(trend, joint, unit, sayer(joint, trend), (run) => link(["runs", run]));
  return (
    <Figure
      title={joint.name}
      note={noteOf(joint)}
      table={{
        columns: [
          text.sets.kind,
          text.runs.when,
          words.role,
          ...alike([text.run.value, text.run.low, text.run.high, words.smoothed, words.lower, words.upper], column),
          words.changed,
          text.run.verdict,
        ],
        rows: trend.campaigns.map(({ name, at, assessment }, i) => {
          const point = joint.points[i];
          return [
            name,
            at.slice(0, 16).replace("T", " "),
            point ? words.roles[point.role] : "",
            maybeInUnit(point?.stiffness, unit, joint.kind),
            ...intervalIn(point?.interval, unit, joint.kind),
            maybeInUnit(point?.smoothed, unit, joint.kind),
            ...(points[i]?.limits ?? [null, null]),
            point?.change ? changeText(point.change) : (point?.reason ?? ""),
            text.usability[assessment.verdict],
          ];
        }),
      }}
    >
      {(width) =>
        points.some((p) => p.value !== null || p.low !== null) ? (
          <TrendChart
            points={points}
            bands={bandsOf(joint, unit)}
            width={width}
            label={words.joint(joint.name)}
            unit={label}
          />
        ) : (
          <p class="soft">{text.verdicts.unobservable}</p>
        )
      }
    </Figure>
  );
}

/** What is said at a point: its campaign, when, and what has changed. */
const sayer = (joint: TrendJoint, trend: Found) => (index: number) => {
  const [campaign, point] = [trend.campaigns[index], joint.points[index]];
  if (!campaign || !point) return "";
  const day = dayText(campaign.at);
  const said = point.change ? changeText(point.change) : (point.reason ?? words.roles[point.role]);
  const alarm = point.exceeded ? joint.alarms.filter((one) => one.since <= campaign.at).at(-1)?.message : undefined;
  return [
    campaign.name,
    campaign.time_source === "measured_at" ? day : words.stored(day),
    said,
    ...(campaign.assessment.verdict === "use" ? [] : [words.verdict(text.usability[campaign.assessment.verdict])]),
    ...(alarm ? [alarm] : []),
  ].join("\n");
};

/** State of a joint in words: its latest change, or what the pair says. */
function noteOf({ state, latest, pair }: TrendJoint): string {
  if (latest) return `${text.fleet.states[state]}: ${words.sinceBaseline(changeText(latest))}`;
  if (pair) return words.pair(changeText(pair.change), pValue(pair.p_value));
  return text.fleet.states[state];
}

function LeftOut({ trend }: { trend: Found }) {
  if (trend.left_out.length === 0) return null;
  return (
    <details>
      <summary>{words.leftOut(trend.left_out.length)}</summary>
      <Rows
        rows={trend.left_out.map(({ measurement_set_id: id, name, reason }) => ({
          id,
          href: link(["sets", id]),
          name,
          what: <Name>{name}</Name>,
          how: reason,
        }))}
      />
    </details>
  );
}
