/** Charts by configuration: bars, stacked bars, residuals; a path a series, so that hundreds of them are few elements. */
import type { ComponentChildren } from "preact";
import { alike } from "../components/table";
import { clip, percent, significant } from "../lib/format";
import { extent, linear } from "../lib/scale";
import { text } from "../i18n";
import { LeftAxis, Names, Chart, Figure } from "./figure";
import { tip } from "../components/basics";

export interface Series {
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
      {names.map((name, i) => (
        <rect // over its whole height: small bars are hard to hit
          class={name === at ? "hit column at" : "hit column"}
          x={place(i) - step / 2}
          width={step}
          y={24}
          height={Math.max(1, bottom - 24)}
          {...tip([name, ...lines(i)], open?.(name))}
        />
      ))}
    </Chart>
  );
}

/** Bars for the first series, narrower ones inside for the second, dots for the others; or all of them stacked. */
export function BarFigure({
  title,
  note,
  names,
  series,
  unit,
  stacked = false,
  ...opening
}: {
  title: string;
  note: string;
  names: string[];
  series: Series[];
  unit: string;
  stacked?: boolean;
} & Opening) {
  if (names.length === 0) return null;
  const value = (one: Series, i: number) => one.values[i] ?? null;
  const heights = stacked ? stacks(names, series) : series.flatMap(({ values }) => values.filter((v) => v !== null));
  const lines = (i: number) =>
    series.flatMap((one) => {
      const height = value(one, i);
      return height === null ? [] : [`${one.label}: ${significant(height, 3)} ${unit}`];
    });
  const columns = [
    text.deflection.configuration,
    ...alike(
      series.map((one) => one.label),
      unit,
    ),
  ];
  return (
    <Figure
      title={title}
      note={note}
      legend={series}
      table={{ columns, rows: names.map((name, i) => [name, ...series.map((one) => value(one, i))]) }}
    >
      {(width) => (
        <ByName {...{ names, width, unit, lines }} label={title} range={extent(heights) ?? [0, 1]} {...opening}>
          {(place, step, y) =>
            series.map((one, s) => {
              const wide = Math.max(1, step * (stacked || s === 0 ? 0.78 : 0.42));
              const shapes = names.map((_, i) => {
                const height = value(one, i);
                if (height === null) return "";
                if (s > 1 && !stacked) return circle(place(i), y(height), Math.min(5, step * 0.3));
                const from = stacked ? below(series.slice(0, s), i, height) : 0;
                return bar(place(i), wide, y(from), y(from + height));
              });
              return <path class={`bars ${one.mark}`} d={shapes.join("")} />;
            })
          }
        </ByName>
      )}
    </Figure>
  );
}

const sum = (values: number[]): number => values.reduce((a, b) => a + b, 0);

/** What the series before have in a column on the side of zero of a height. */
const below = (series: Series[], i: number, height: number): number =>
  sum(series.map(({ values }) => values[i] ?? 0).filter((value) => value < 0 === height < 0));

/** Both ends of each stack. */
const stacks = (names: string[], series: Series[]): number[] =>
  names.flatMap((_, i) => [below(series, i, -1), below(series, i, 1)]);

const bar = (x: number, wide: number, from: number, to: number): string =>
  `M${x - wide / 2} ${Math.min(from, to)}h${wide}v${Math.max(1, Math.abs(to - from))}h${-wide}z`;

export const circle = (x: number, y: number, r: number): string =>
  `M${x - r} ${y}a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0z`;

/** As many digits as the steps of the axis need. */
function axisFormat(ticks: number[]): (value: number) => string {
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
