/** One joint over time: a point with its interval for each campaign, its EWMA between limits; logarithmic. */
import { significant } from "../lib/format";
import { dayText } from "../components/basics";
import { extent, logarithmic } from "../lib/scale";
import { go } from "../state/router";
import { LeftAxis } from "./axis";
import { Chart } from "./figure";
import { tip } from "./tip";

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

export function Trend({
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
