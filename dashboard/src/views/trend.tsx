/** Each joint of one robot over its campaigns: charts against a baseline, alarms, and new baselines. */
import { significant, pValue, extent, logarithmic } from "../lib/format";
import { dayText, Button, Form, Name, When, Badge, Empty, Head, MeasureLink, Show } from "../components/basics";
import { go, useAction, link } from "../state/action";
import { LeftAxis, Chart, Figure, Legend } from "../charts/figure";
import { useState } from "preact/hooks";
import { api } from "../api/client";
import type { TrendAlarm, Method, Trend as Found, TrendJoint } from "../api/types";
import { TextField, Select } from "../components/fields";
import { changedTogether, bandsOf, changeText, pointsOf, worstFirst } from "../lib/trend";
import { namesChanged, useLoad, useNames, valueOf } from "../state/load";
import { later } from "../i18n/later";
import { alike } from "../components/table";
import { Rows } from "../components/list";
import { unitOf } from "../lib/stiffness";
import { useSettings } from "../state/session";
import { type IntervalMark, Mark } from "./joint_table";
import { text } from "../i18n";
import { type Fields, stated, unreadIn } from "../lib/json";
import { SchemaFields } from "../components/schema_form";

export interface TrendPoint extends IntervalMark {
  time: number;
  /** EWMA after this campaign and its limits; null before there are any. */
  smoothed: number | null;
  limits: [number, number] | null;
  /** Whether the EWMA is beyond a limit. */
  alarm: boolean;
  /** Which baseline it belongs to: lines are drawn within one only. */
  part: number;
}

export interface TrendBand {
  part: number;
  low: number;
  high: number;
}

const HEIGHT = 240;

/** Across becomes up: marks are drawn along x. */
const UPRIGHT = "matrix(0 1 1 0 0 0)";

interface Ground {
  x: (point: TrendPoint) => number;
  y: (value: number) => number;
}

interface ChartProps {
  points: TrendPoint[];
  bands: TrendBand[];
  width: number;
  label: string;
  unit: string;
}

function TrendChart({ points, bands, width, label, unit }: ChartProps) {
  const [left, right, bottom] = [60, width - 16, HEIGHT - 34];
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
    <Chart width={width} height={HEIGHT} label={label} links>
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
        const { low, value, smoothed, lines, open } = point;
        if (low === null && (value === null || value <= 0)) return null;
        const x = ground.x(point);
        const link = open && {
          role: "link" as const,
          tabindex: 0, // of an SVG element: its attributes keep their case
          "aria-label": lines.join(", "),
          onKeyDown: (event: KeyboardEvent) => event.key === "Enter" && go(open),
        };
        return (
          <g class="interval" {...link}>
            <g transform={UPRIGHT}>
              <Mark mark={point} x={y} y={x} left={bottom} right={28} />
            </g>
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
  const line = (value: (p: TrendPoint) => number | null | undefined) => {
    const at = followed.flatMap((p) => (value(p) ? [`${ground.x(p)} ${ground.y(value(p) ?? 0)}`] : []));
    return at.length > 0 ? `M${at.join("L")}` : "";
  };
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

interface Noted {
  trend: Found;
  reload: () => void;
}

/** Alarms that last, each with its reason and who has seen it; those that ended are folded away. */
function Alarms({ trend, reload }: Noted) {
  const raised = trend.joints.flatMap(({ name, alarms }) => alarms.map((alarm) => ({ joint: name, alarm })));
  const [lasting, ended] = [true, false].map((lasts) =>
    raised
      .filter(({ alarm }) => (alarm.until === null) === lasts)
      .map((one) => <Alarm key={`${one.joint}/${one.alarm.run_id}`} robot={trend.robot_id} {...one} reload={reload} />),
  );
  return (
    <>
      {changedTogether(trend.joints) && <p class="note warn">{words.together}</p>}
      {lasting}
      {ended && ended.length > 0 && (
        <details>
          <summary>{words.ended(ended.length)}</summary>
          {ended}
        </details>
      )}
    </>
  );
}

interface AlarmProps {
  robot: string;
  joint: string;
  alarm: TrendAlarm;
  reload: () => void;
}

function Alarm({ robot, joint, alarm, reload }: AlarmProps) {
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
function NewBaseline({ trend, reload }: Noted) {
  const [asked, setAsked] = useState<Fields>({ run_id: trend.campaigns.at(-1)?.run_id });
  const send = useAction(async () => {
    await api.addBaseline(trend.robot_id, stated(asked));
    reload();
  });
  const campaigns = trend.campaigns.map(({ run_id, name, at }) => ({
    value: run_id,
    label: `${dayText(at)}, ${name}`,
  }));
  return (
    <details class="baselines">
      <summary>{words.baselines(trend.baselines.length)}</summary>
      <ul>
        {trend.baselines.map(({ starts_at: start, reason: why, campaigns: count, set_by: by }) => (
          <li>
            <When time={start} />: <Name>{why ?? words.firstCampaigns}</Name> ({text.fleet.campaigns(count)}
            {by ? `, ${by.key_name}` : ""})
          </li>
        ))}
      </ul>
      <Form action={send}>
        <SchemaFields
          of="BaselineRequest"
          show={["run_id", "reason", "campaigns"]}
          value={asked}
          change={setAsked}
          terms={{ labels: words.baseline, choices: { run_id: campaigns } }}
        />
        <Button acts type="submit" disabled={send.busy || !asked["reason"] || unreadIn(asked) !== null}>
          {words.begin}
        </Button>
      </Form>
    </details>
  );
}

interface Asked {
  method?: Method;
  encoders?: NonNullable<Found["selection"]>["encoders"];
}

export function TrendView({ robot: id, serial }: { robot: string; serial: string | null }) {
  const [asked, setAsked] = useState<Asked>({});
  const trend = useLoad((signal) => api.trend(id, { ...asked, serial_number: serial }, signal), [id, asked, serial]);
  const name = valueOf(useNames())?.robot(id) ?? "…";
  return (
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
                value={asked.method ?? found.selection?.method ?? "partial_pose"}
                change={(method) => setAsked({ ...asked, method: method as Method })}
                options={text.methods}
              />
              <Select
                label={words.encoders}
                value={asked.encoders ?? found.selection?.encoders ?? "motor"}
                change={(encoders) => setAsked({ ...asked, encoders: encoders as "motor" })}
                options={text.files.encoders}
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
            <Charts trend={found} reload={trend.reload} />
            {found.left_out.length > 0 && (
              <details>
                <summary>{words.leftOut(found.left_out.length)}</summary>
                <Rows
                  rows={found.left_out.map(({ measurement_set_id: set, name, reason }) => ({
                    id: set,
                    href: link(["sets", set]),
                    name,
                    how: reason,
                  }))}
                />
              </details>
            )}
          </>
        )}
      </Show>
    </>
  );
}

/** The serial numbers of the robot's sets, and that the chart shown is of sets without one. */
const serialsOf = ({ selection, serial_numbers: serials }: Found) => [
  ...(selection?.serial_number ? [] : [{ value: "", label: text.fleet.noSerial }]),
  ...serials.map((value) => ({ value, label: value })),
];

function Charts({ trend, reload }: Noted) {
  if (trend.campaigns.length === 0)
    return (
      <Empty title={words.none} hint={words.noneHint}>
        <MeasureLink robot={trend.robot_id} />
      </Empty>
    );
  return (
    <>
      {trend.note !== null && <p class="note">{words.notYet(trend.note)}</p>}
      <Alarms trend={trend} reload={reload} />
      <p class="hint">
        {trend.false_alarms.joints > 0 && words.rate(trend.false_alarms)}
        {words.axes}
      </p>
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
        <summary>{text.fleet.campaigns(trend.campaigns.length)}</summary>
        <Rows
          rows={trend.campaigns.map(({ run_id: id, name, at, assessment }) => ({
            id,
            href: link(["runs", id]),
            name,
            at,
            standing: <Badge verdict={assessment.verdict} />,
          }))}
        />
      </details>
      <NewBaseline trend={trend} reload={reload} />
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
          const [drawn, point] = [points[i], joint.points[i]];
          return [
            name,
            at.slice(0, 16).replace("T", " "),
            point ? words.roles[point.role] : "",
            ...[drawn?.value, drawn?.low, point?.interval ? drawn?.high : null, drawn?.smoothed],
            ...(drawn?.limits ?? [null, null]),
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
          <p class="soft">{text.verdicts.unobservable[0]}</p>
        )
      }
    </Figure>
  );
}

/** What is said at a point: its campaign, when, and what has changed. */
const sayer = (joint: TrendJoint, trend: Found) => (index: number) => {
  const [campaign, point] = [trend.campaigns[index], joint.points[index]];
  if (!campaign || !point) return [];
  const day = dayText(campaign.at);
  const said = point.change ? changeText(point.change) : (point.reason ?? words.roles[point.role]);
  const alarm = point.exceeded ? joint.alarms.filter((one) => one.since <= campaign.at).at(-1)?.message : undefined;
  return [
    campaign.name,
    campaign.time_source === "measured_at" ? day : words.stored(day),
    said,
    ...(campaign.assessment.verdict === "use" ? [] : [words.verdict(text.usability[campaign.assessment.verdict])]),
    ...(alarm ? [alarm] : []),
  ];
};

/** State of a joint in words: its latest change, or what the pair says. */
function noteOf({ state, latest, pair }: TrendJoint): string {
  if (latest) return `${text.fleet.states[state]}: ${words.sinceBaseline(changeText(latest))}`;
  if (pair) return words.pair(changeText(pair.change), pValue(pair.p_value));
  return text.fleet.states[state];
}
