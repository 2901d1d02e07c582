/** Each joint of one robot over its campaigns: charts with intervals, and whether the latest differs from the first. */
import { dayText, significant, pValue, extent, logarithmic, timeText } from "../../lib/format";
import { Name, Badge, Empty, Head, MeasureLink, Show, Toggle } from "../../components/basics";
import { go, link } from "../../state/action";
import { LeftAxis, Chart, Figure } from "../../charts/figure";
import { useState } from "preact/hooks";
import { queries } from "../../api/queries";
import type { Method, Trend as Found, TrendJoint } from "../../api/types";
import { Select } from "../../components/fields";
import { changeText, comparedText, pointsOf, type TrendPoint, whenTexts, worstFirst } from "./trend";
import { useQuery } from "../../state/query";
import { Estimate } from "../../components/estimate";
import { alike, type Cell } from "../../components/table";
import { Rows } from "../../components/list";
import { shownWithInterval, unitOf } from "../../lib/stiffness";
import { useSettings } from "../../state/session";
import { Mark } from "../run/joint_table";
import { text } from "../../words";
import { compareWords } from "../compare/words";
import { trendWords } from "./words";

const HEIGHT = 240;

/** Across becomes up: marks are drawn along x. */
const UPRIGHT = "matrix(0 1 1 0 0 0)";

interface ChartProps {
  points: TrendPoint[];
  width: number;
  label: string;
  unit: string;
}

function TrendChart({ points, width, label, unit }: ChartProps) {
  const [left, right, bottom] = [60, width - 16, HEIGHT - 34];
  const numbers = points.flatMap((p) => [p.value, p.low, p.high]).filter((v): v is number => v !== null && v > 0);
  const [low, high] = extent(numbers) ?? [1, 10];
  const room = Math.max(1.01, (high / low) ** 0.12);
  const y = logarithmic(low / room, high * room, bottom, 28, 5);
  const times = extent(points.map((p) => p.time)) ?? [0, 1];
  const place = placeIn(points, times, left + 24, right - 24);
  return (
    <Chart width={width} height={HEIGHT} label={label} links>
      <LeftAxis
        scale={y}
        left={left}
        right={right}
        format={(v) => (v < 1e4 ? String(Number(v.toPrecision(4))) : significant(v, 3))}
        unit={unit}
      />
      {points.map((point) => {
        const { low, value, lines, open } = point;
        if (low === null && (value === null || value <= 0)) return null;
        const x = place(point);
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

const words = trendWords;

interface Asked {
  method?: Method;
  encoders?: NonNullable<Found["selection"]>["encoders"];
}

export function TrendView({ robot: id, serial }: { robot: string; serial: string | null }) {
  const [asked, setAsked] = useState<Asked>({});
  const [sameLoadPoint, setSameLoadPoint] = useState(false);
  const shared = sameLoadPoint ? { same_load_point: "true" } : {};
  const trend = useQuery(queries.trend(id, { ...asked, ...shared, serial_number: serial }));
  const name = useQuery(queries.robot(id)).data?.name ?? "…";
  return (
    <>
      <Head
        kind={compareWords.trend}
        plain={words.title(name)}
        title={<Name>{name}</Name>}
        about={
          <>
            <a href={link(["robots", id])}>{text.start.robot}</a>
          </>
        }
      />
      <Toggle label={compareWords.sameLoadPoint} checked={sameLoadPoint} change={setSameLoadPoint} />
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
            <Charts trend={found} />
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
  ...(selection?.serial_number ? [] : [{ value: "", label: words.noSerial }]),
  ...serials.map((value) => ({ value, label: value })),
];

function Charts({ trend }: { trend: Found }) {
  if (trend.campaigns.length === 0)
    return (
      <Empty title={words.none} hint={words.noneHint}>
        <MeasureLink robot={trend.robot_id} />
      </Empty>
    );
  const changed = trend.joints.filter((joint) => joint.changed);
  return (
    <>
      {changed.map((joint) => (
        <p key={joint.name} class="note bad">
          <b class="state changed">{words.changed}</b> <Name>{joint.name}</Name>{" "}
          {joint.change && `${changeText(joint.change)} ${comparedText(trend.campaigns, joint)}`}
        </p>
      ))}
      {trend.note !== null && <p class="note warn">{words.said(trend.note)}</p>}
      <div class="multiples">
        {worstFirst(trend.joints).map((joint) => (
          <JointTrend key={joint.name} joint={joint} trend={trend} />
        ))}
      </div>
      <p class="hint">
        {trend.campaigns.length > 1 && words.test(trend.level)}
        {words.axes}
      </p>
      <details open={trend.campaigns.some(({ verdict }) => verdict !== "use")}>
        <summary>{words.campaigns(trend.campaigns.length, trend.campaign_count)}</summary>
        <Rows
          rows={trend.campaigns.map(({ run_id: id, name, at, verdict }) => ({
            id,
            href: link(["runs", id]),
            name,
            at,
            standing: <Badge verdict={verdict} />,
          }))}
        />
      </details>
    </>
  );
}

function JointTrend({ joint, trend }: { joint: TrendJoint; trend: Found }) {
  const { unit } = useSettings();
  const { label, column } = unitOf(unit, joint.kind);
  const points = pointsOf(trend, joint, unit, sayer(joint, trend), (run) => link(["runs", run]));
  const rows = trend.campaigns.map(({ name, at, verdict }, i): Cell[] => {
    const [drawn, point] = [points[i], joint.points[i]];
    const numbers = [drawn?.value, drawn?.low, point?.interval ? drawn?.high : null];
    return [name, timeText(at), ...numbers, point?.reason ?? "", text.usability[verdict]];
  });
  const estimates = joint.points.map(({ stiffness, interval }) => (
    <Estimate of={shownWithInterval(stiffness ?? null, interval ?? null, unit, joint.kind)} />
  ));
  return (
    <Figure
      title={joint.name}
      note={noteOf(joint, trend)}
      table={{
        columns: [text.sets.kind, text.runs.when, `${text.run.value} [${label}]`, words.reason, text.run.verdict],
        texts: [0, 1, 3, 4],
        rows: rows.map(([name, when, , , , ...rest], i) => [name, when, estimates[i], ...rest]),
      }}
      file={{
        columns: [
          text.sets.kind,
          text.runs.when,
          ...alike([text.run.value, text.run.low, text.run.high], column),
          words.reason,
          text.run.verdict,
        ],
        rows,
      }}
    >
      {(width) =>
        points.some((p) => p.value !== null || p.low !== null) ? (
          <TrendChart points={points} width={width} label={words.joint(joint.name)} unit={label} />
        ) : (
          <p class="soft">{text.verdicts.unobservable[0]}</p>
        )
      }
    </Figure>
  );
}

/** What is said at a point: its campaign, and when. */
const sayer = (joint: TrendJoint, trend: Found) => (index: number) => {
  const [campaign, point] = [trend.campaigns[index], joint.points[index]];
  if (!campaign || !point) return [];
  const when = whenTexts(trend.campaigns.map(({ at }) => at))[index] ?? "";
  return [
    campaign.name,
    campaign.time_source === "measured_at" ? when : words.stored(when),
    ...(point.reason === null ? [] : [point.reason]),
    ...(campaign.verdict === "use" ? [] : [words.verdict(text.usability[campaign.verdict])]),
  ];
};

/** The test of a joint in words: its change between two campaigns. */
const noteOf = (joint: TrendJoint, { campaigns }: Found): string => {
  const { change, p_value: p, changed } = joint;
  if (!change || p === null) return words.untested;
  return words.pair(changed, changeText(change), comparedText(campaigns, joint), pValue(p));
};
