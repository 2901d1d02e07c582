/** Bars: one or more series by configuration, and shares of joints. */
import type { ComponentChildren } from "preact";
import { clip, percent, significant } from "../lib/format";
import { extent, linear } from "../lib/scale";
import { LeftAxis, Names } from "./axis";
import { Chart } from "./figure";
import { tip } from "./tip";

interface Series {
  mark: string;
  label: string;
  values: (number | null)[];
}

/** Where a click on a column leads, and which column one came back to. */
export interface Opening {
  open?: ((name: string) => string) | undefined;
  at?: string | null | undefined;
}

/** A drawing above each name, over one axis; a column says its `lines` when it is pointed at, over its whole height. */
export function ByName({
  names,
  range,
  width,
  height = 300,
  label,
  unit,
  lines,
  open,
  at,
  children,
}: {
  names: string[];
  /** Least and greatest value. */
  range: readonly [number, number];
  width: number;
  height?: number;
  label: string;
  unit: string;
  lines: (index: number) => string[];
  children: (place: (index: number) => number, step: number, y: (value: number) => number) => ComponentChildren;
} & Opening) {
  const [left, right, bottom] = [56, width - 8, height - 34];
  const least = Math.min(0, range[0]);
  // what is too small to be seen would take a step of the axis
  const y = linear(-least < 0.01 * range[1] ? 0 : least, Math.max(0, range[1]), bottom, 28);
  const step = (right - left) / Math.max(1, names.length);
  const place = (i: number) => left + (i + 0.5) * step;
  return (
    <Chart width={width} height={height} label={label}>
      <LeftAxis scale={y} left={left} right={right} format={axisFormat(y.ticks)} unit={unit} />
      {children(place, step, y)}
      <Names names={names} place={place} bottom={bottom} room={right - left} />
      <Columns {...{ names, place, step, bottom, lines, open, at }} />
    </Chart>
  );
}

/** Bars for the first series, narrower ones inside for the second, dots for the others. */
export function Bars({
  series,
  format = (v) => significant(v, 3),
  ...frame
}: {
  names: string[];
  series: Series[];
  width: number;
  height?: number;
  label: string;
  unit: string;
  format?: (value: number) => string;
} & Opening) {
  const lines = (i: number) =>
    series.flatMap((one) => {
      const value = one.values[i];
      return value === null || value === undefined ? [] : [`${one.label}: ${format(value)} ${frame.unit}`];
    });
  const range = extent(series.flatMap((s) => s.values.filter((v) => v !== null))) ?? [0, 1];
  return (
    <ByName {...frame} range={range} lines={lines}>
      {(place, step, y) =>
        series.map((one, s) => (
          <g class={`bars ${one.mark}`}>
            {one.values.map(
              (value, i) =>
                value !== null &&
                (s < 2 ? (
                  <Bar x={place(i)} width={step * (s === 0 ? 0.78 : 0.42)} from={y(0)} to={y(value)} />
                ) : (
                  <circle cx={place(i)} cy={y(value)} r={Math.min(5, step * 0.3)} />
                )),
            )}
          </g>
        ))
      }
    </ByName>
  );
}

/** What a column says when it is pointed at, over its whole height: small bars are hard to hit. */
function Columns({
  names,
  place,
  step,
  bottom,
  lines,
  open,
  at,
}: {
  names: string[];
  place: (index: number) => number;
  step: number;
  bottom: number;
  lines: (index: number) => string[];
} & Opening) {
  return (
    <g>
      {names.map((name, i) => (
        <rect
          class={name === at ? "hit column at" : "hit column"}
          x={place(i) - step / 2}
          width={step}
          y={24}
          height={Math.max(1, bottom - 24)}
          {...tip([name, ...lines(i)], open?.(name))}
        />
      ))}
    </g>
  );
}

function Bar({ x, width, from, to }: { x: number; width: number; from: number; to: number }) {
  const wide = Math.max(1, width);
  return <rect x={x - wide / 2} width={wide} y={Math.min(from, to)} height={Math.max(1, Math.abs(to - from))} />;
}

/** As many digits as the steps of the axis need. */
export function axisFormat(ticks: number[]): (value: number) => string {
  const step = Math.abs((ticks[1] ?? 1) - (ticks[0] ?? 0)) || 1;
  const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  return (value) => value.toFixed(Math.min(decimals, 6)).replace("-", "\u2212");
}

/** A bar a joint, its share written at its end. */
export function Shares({
  shares,
  width,
  label,
}: {
  shares: { name: string; share: number; note: string }[];
  width: number;
  label: string;
}) {
  const longest = Math.max(0, ...shares.map(({ name }) => name.length));
  const left = Math.min(longest * 10 + 20, width < 480 ? 150 : 260);
  const room = Math.max(40, width - left - (shares.some(({ note }) => note) ? 150 : 80));
  const [low, high] = extent([0, ...shares.map(({ share }) => share)]) ?? [0, 1];
  const place = (share: number) => left + ((share - low) / Math.max(1e-9, high - low)) * room;
  return (
    <Chart width={width} height={shares.length * 44 + 8} label={label}>
      {shares.map(({ name, share, note }, i) => (
        <g class={`bars joint-${i % 6}`}>
          <text class="row" x={left - 10} y={i * 44 + 31} text-anchor="end">
            {clip(name, Math.floor((left - 20) / 10))}
          </text>
          <rect
            x={Math.min(place(0), place(share))}
            y={i * 44 + 10}
            height={30}
            width={Math.max(1.5, Math.abs(place(share) - place(0)))}
          />
          <text class="row strong" x={Math.max(place(share), place(0)) + 10} y={i * 44 + 31}>
            {percent(share)} <tspan class="soft">{note}</tspan>
          </text>
        </g>
      ))}
    </Chart>
  );
}

/** Stacked bars: what each joint adds, by configuration. */
export function Stacks({
  parts,
  ...frame
}: {
  names: string[];
  /** For each configuration, what each joint adds. */
  parts: { name: string; values: number[] }[];
  width: number;
  label: string;
  unit: string;
} & Opening) {
  const ends = frame.names.flatMap((_, i) => {
    const values = parts.map((part) => part.values[i] ?? 0);
    const total = (of: number[]) => of.reduce((a, b) => a + b, 0);
    return [total(values.filter((v) => v < 0)), total(values.filter((v) => v > 0))];
  });
  const lines = (i: number) =>
    parts.map((part) => `${part.name}: ${significant(part.values[i] ?? 0, 3)} ${frame.unit}`);
  return (
    <ByName {...frame} range={extent(ends) ?? [0, 1]} lines={lines}>
      {(place, step, y) =>
        frame.names.map((_, i) => {
          let [down, up] = [0, 0];
          return parts.map((part, j) => {
            const value = part.values[i] ?? 0;
            const from = value < 0 ? down : up;
            if (value < 0) down += value;
            else up += value;
            return (
              <g class={`bars joint-${j % 6}`}>
                <Bar x={place(i)} width={step * 0.78} from={y(from)} to={y(from + value)} />
              </g>
            );
          });
        })
      }
    </ByName>
  );
}
