/** Values with intervals on a logarithmic axis, a row each; an end that is open is an arrow. */
import type { JointResult } from "../api/types";
import { axisStiffness, shownStiffness } from "../lib/stiffness";
import { STIFFNESS_UNITS, type StiffnessUnit, unitOf } from "../lib/units";
import { verdictOf } from "../lib/verdict";
import { text } from "../i18n";
import { clip } from "../lib/format";
import { type Scale, extent, logarithmic } from "../lib/scale";
import { BottomAxis } from "./axis";
import { Chart } from "./figure";
import { tip } from "./tip";

export interface IntervalMark {
  /** Which series: class of the mark. */
  mark: string;
  value: number | null;
  low: number | null;
  /** Null: no upper limit. */
  high: number | null;
  /** Said where there is nothing to draw. */
  instead?: string | null;
  label: string;
}

export interface IntervalRow {
  name: string;
  marks: IntervalMark[];
}

const MARK_HEIGHT = 26;
const ROW_GAP = 22;

interface IntervalsProps {
  rows: IntervalRow[];
  width: number;
  label: string;
  unit: string;
  format: (value: number) => string;
  /** Where a dashed line stands, such as no change. */
  reference?: number;
}

export function Intervals({ rows, width, label, unit, format, reference }: IntervalsProps) {
  const narrow = width < 480;
  const left = narrow ? 14 : 96;
  const right = width - 28;
  const head = narrow ? 22 : 0;
  const heights = rows.map((row) => head + spoken(row.marks).length * MARK_HEIGHT + ROW_GAP);
  const bottom = heights.reduce((sum, height) => sum + height, 8);
  const [low, high] = bounds(rows, reference);
  const x = logarithmic(low, high, left + 8, right, width < 480 ? 5 : 9);
  let top = 8;
  return (
    <Chart width={width} height={bottom + 52} label={label}>
      <BottomAxis scale={x} top={4} bottom={bottom} format={format} unit={unit} right={width - 8} />
      {reference !== undefined && <line class="reference" x1={x(reference)} x2={x(reference)} y1={4} y2={bottom} />}
      {rows.map((row, i) => {
        const start = top;
        top += heights[i] ?? 0;
        const middle = start + head + ROW_GAP / 2 + (spoken(row.marks).length * MARK_HEIGHT) / 2;
        return (
          <g>
            {i > 0 && <line class="between" x1={0} x2={width} y1={start} y2={start} />}
            <text
              class="row"
              x={narrow ? 4 : left - 10}
              y={narrow ? start + 22 : middle + 5}
              text-anchor={narrow ? "start" : "end"}
            >
              {clip(row.name, narrow ? 36 : 10)}
            </text>
            {spoken(row.marks).map((mark, k) => (
              <Mark
                mark={mark}
                x={x}
                y={start + head + ROW_GAP / 2 + (k + 0.5) * MARK_HEIGHT}
                left={left + 8}
                right={right}
              />
            ))}
          </g>
        );
      })}
    </Chart>
  );
}

/** Stiffnesses in the unit of the page. */
export const StiffnessIntervals = ({
  unit,
  ...rest
}: Pick<IntervalsProps, "rows" | "width" | "label"> & { unit: StiffnessUnit }) => (
  <Intervals {...rest} unit={STIFFNESS_UNITS[unit].label} format={axisStiffness(unit)} />
);

/** The axis of rows that stand in a table. */
export function intervalAxis(rows: IntervalRow[], width: number, margin: number): Scale {
  const [low, high] = bounds(rows, undefined);
  return logarithmic(low, high, margin, width - margin - 8, width < 320 ? 4 : 7);
}

export function RowAxis({
  axis,
  width,
  format,
  label,
}: {
  axis: Scale;
  width: number;
  format: (value: number) => string;
  label: string;
}) {
  return (
    <svg class="row-chart" width={width} height={22} role="img" aria-label={label}>
      {axis.ticks.map((tick) => (
        <text class="tick" x={axis(tick)} y={16} text-anchor="middle">
          {format(tick)}
        </text>
      ))}
    </svg>
  );
}

/** One row's marks above the lines of the axis. */
export function RowMarks({ row, axis, width }: { row: IntervalRow; axis: Scale; width: number }) {
  const marks = spoken(row.marks);
  const height = Math.max(40, marks.length * MARK_HEIGHT + 8);
  const top = (height - marks.length * MARK_HEIGHT) / 2;
  return (
    <svg
      class="row-chart"
      width={width}
      height={height}
      role="img"
      aria-label={row.marks.map((one) => one.label).join("; ")}
    >
      {axis.ticks.map((tick) => (
        <line class="grid" x1={axis(tick)} x2={axis(tick)} y1={0} y2={height} />
      ))}
      {marks.map((mark, k) =>
        mark.low === null && mark.value === null ? null : (
          <Mark mark={mark} x={axis} y={top + (k + 0.5) * MARK_HEIGHT} left={2} right={width - 10} />
        ),
      )}
    </svg>
  );
}

/** Where all series say the same instead of a value, once is enough. */
function spoken(marks: IntervalMark[]): IntervalMark[] {
  const silent = marks.every((mark) => mark.low === null && mark.value === null && mark.instead === marks[0]?.instead);
  return silent ? marks.slice(0, 1) : marks;
}

function Mark({
  mark,
  x,
  y,
  left,
  right,
}: {
  mark: IntervalMark;
  x: (value: number) => number;
  y: number;
  left: number;
  right: number;
}) {
  if (mark.low === null && mark.value === null) {
    return (
      <text class={`instead ${mark.mark}`} x={left} y={y + 5}>
        {mark.instead}
      </text>
    );
  }
  const from = mark.low !== null && mark.low > 0 ? x(mark.low) : left;
  const to = mark.high === null ? right : x(mark.high);
  const hidden = to - from < 15 && mark.value !== null; // the point covers the ends
  return (
    <g class={`interval ${mark.mark}`} {...tip(mark.label.split(": "))}>
      <rect class="hit" x={Math.min(from, to) - 10} y={y - 12} width={Math.abs(to - from) + 20} height={24} />
      <line x1={from} x2={mark.high === null && mark.low !== null ? to - 6 : to} y1={y} y2={y} />
      {mark.low !== null && !hidden && <line class="end" x1={from} x2={from} y1={y - 7} y2={y + 7} />}
      {mark.high !== null && mark.high !== mark.value && !hidden && (
        <line class="end" x1={to} x2={to} y1={y - 7} y2={y + 7} />
      )}
      {mark.high === null && mark.low !== null && <path class="head" d={`M${to + 8} ${y} l-15 -8 v16 z`} />}
      {mark.value !== null && <circle cx={x(mark.value)} cy={y} r={6.5} />}
    </g>
  );
}

/** The axis holds all numbers, with some room; open ends do not count. */
function bounds(rows: IntervalRow[], reference: number | undefined): [number, number] {
  const values = rows.flatMap((row) => row.marks.flatMap((mark) => [mark.value, mark.low, mark.high]));
  const found = extent([...values, reference ?? null].filter((value): value is number => value !== null && value > 0));
  const [low, high] = found ?? [1, 10];
  // a bar that ends near zero would leave no room for the others
  const points = extent(rows.flatMap((row) => row.marks.map((mark) => mark.value ?? 0)).filter((value) => value > 0));
  const least = points ? Math.max(low, points[0] / 1e3) : low;
  return [least / 1.25, Math.max(high * 1.25, least * 3)];
}

export function markOf(joint: JointResult, mark: string, unit: StiffnessUnit): IntervalMark {
  const shown = shownStiffness(joint, unit);
  const negative = joint.stiffness !== null && joint.stiffness < 0;
  // where it stands on the axis: its number in its own unit is that of the axis
  const scale = unitOf(unit, joint.kind).factor / unitOf(unit).factor;
  const [value, interval] = [onAxis(joint.stiffness, scale, unit), joint.stiffness_interval];
  const instead = negative ? `${text.run.negative}: ${shown.value ?? ""}` : text.verdicts[verdictOf(joint)];
  const range = shown.interval ? ` (${shown.interval.low} … ${shown.interval.high ?? "∞"})` : "";
  return {
    mark,
    value: negative ? null : value,
    low: onAxis(interval?.[0], scale, unit) ?? (negative ? null : value),
    high: interval ? onAxis(interval[1], scale, unit) : value,
    instead,
    label: `${joint.name}: ${shown.value ?? instead}${range} ${unitOf(unit, joint.kind).label}`,
  };
}

const onAxis = (stiffness: number | null | undefined, scale: number, unit: StiffnessUnit): number | null =>
  stiffness === null || stiffness === undefined
    ? null
    : STIFFNESS_UNITS[unit].inverse
      ? stiffness / scale
      : stiffness * scale;
