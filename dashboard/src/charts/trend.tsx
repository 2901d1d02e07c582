/** One joint over time: a point with its interval for each run, logarithmic. */
import { significant } from "../lib/format";
import { extent, logarithmic } from "../lib/scale";
import { LeftAxis } from "./axis";
import { Chart } from "./figure";
import { tip } from "./tip";

export interface TrendPoint {
  time: number;
  value: number | null;
  low: number | null;
  high: number | null;
  mark: string;
  title: string;
  /** Address of its run. */
  open?: string;
}

export function Trend({
  points,
  width,
  height = 220,
  label,
  unit,
}: {
  points: TrendPoint[];
  width: number;
  height?: number;
  label: string;
  unit: string;
}) {
  const [left, right, bottom] = [60, width - 16, height - 34];
  const numbers = points.flatMap((p) => [p.value, p.low, p.high]).filter((v): v is number => v !== null && v > 0);
  const [low, high] = extent(numbers) ?? [1, 10];
  const y = logarithmic(low / 1.15, high * 1.15, bottom, 28, 5);
  const times = extent(points.map((p) => p.time)) ?? [0, 1];
  const x = placeIn(points, times, left + 24, right - 24);
  return (
    <Chart width={width} height={height} label={label}>
      <LeftAxis
        scale={y}
        left={left}
        right={right}
        format={(v) => (v < 1e4 ? String(Number(v.toPrecision(3))) : significant(v, 2))}
        unit={unit}
      />
      {[...new Set(points.map((p) => p.mark))].map((mark) => (
        <path
          class="thread"
          d={thread(
            points.filter((p) => p.mark === mark),
            x,
            y,
          )}
        />
      ))}
      {points.map((p) => (
        <Point point={p} x={x(p)} y={y} top={28} bottom={bottom} />
      ))}
      {points.length > 0 && <Dates first={times[0]} last={times[1]} from={left} to={right} y={bottom + 22} />}
    </Chart>
  );
}

/** Through the points of one kind only: encoders switched on are no change of the gearbox. */
function thread(points: TrendPoint[], x: (point: TrendPoint) => number, y: (value: number) => number): string {
  return points
    .filter((p) => p.value !== null && p.value > 0)
    .map((p, i) => `${i ? "L" : "M"}${x(p)} ${y(p.value ?? 1)}`)
    .join("");
}

function Point({
  point,
  x,
  y,
  top,
  bottom,
}: {
  point: TrendPoint;
  x: number;
  y: (value: number) => number;
  top: number;
  bottom: number;
}) {
  if (point.low === null && (point.value === null || point.value <= 0)) return null;
  const end = point.high === null ? top : y(point.high);
  const start = point.low === null ? null : point.low > 0 ? y(point.low) : bottom; // zero lies below any decade
  const hidden = start !== null && start - end < 15 && point.value !== null;
  return (
    <g class={`interval ${point.mark}`} {...tip(point.title.split("\n"), point.open)}>
      <rect class="hit" x={x - 12} width={24} y={top} height={Math.max(24, bottom - top)} />
      {start !== null && <line x1={x} x2={x} y1={start} y2={end} />}
      {start !== null && !hidden && <line class="end" x1={x - 6} x2={x + 6} y1={start} y2={start} />}
      {point.high !== null && point.low !== null && !hidden && (
        <line class="end" x1={x - 6} x2={x + 6} y1={end} y2={end} />
      )}
      {point.high === null && point.low !== null && <path class="head" d={`M${x} ${top - 6} l-7 13 h14 z`} />}
      {point.value !== null && point.value > 0 && <circle cx={x} cy={y(point.value)} r={6} />}
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

function Dates({ first, last, from, to, y }: { first: number; last: number; from: number; to: number; y: number }) {
  const date = (time: number) => new Date(time).toLocaleDateString(undefined, { dateStyle: "medium" });
  return (
    <g class="axis">
      <text x={from} y={y}>
        {date(first)}
      </text>
      {date(first) !== date(last) && (
        <text x={to} y={y} text-anchor="end">
          {date(last)}
        </text>
      )}
    </g>
  );
}
