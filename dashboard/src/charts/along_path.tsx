/** Deflections along a path: a line for each state, one of them with its band, and the chosen point. */
import { extent, linear } from "../lib/format";
import { text } from "../words";
import { BottomAxis, Chart, Figure, LeftAxis } from "./figure";

export interface PathLine {
  mark: string;
  label: string;
  /** NaN where there is none. */
  values: number[];
}

export interface PathBand {
  /** That of its line. */
  mark: string;
  label: string;
  ends: (readonly [number, number])[];
}

interface AlongPathProps {
  title: string;
  note?: string;
  /** Lengths of the path up to its points. */
  along: number[];
  lines: PathLine[];
  /** Intervals of lines at each point. */
  bands: PathBand[];
  /** Names of length and value with their units, for the axes and the table. */
  axes: { along: string; value: string; unit: string; alongUnit: string };
  chosen: number;
  choose: (point: number) => void;
}

const HEIGHT = 280;

export function AlongPath({ title, note, along, lines, bands, axes, chosen, choose }: AlongPathProps) {
  const ends = bands.flatMap((band) => band.ends.map(([, high]) => high));
  const most = extent([...lines.flatMap(({ values }) => values), ...ends].filter(Number.isFinite))?.[1] ?? 1;
  const legend = [...lines, ...bands.map(({ mark, label }) => ({ mark: `band ${mark}`, label }))];
  return (
    <Figure
      title={title}
      {...(note === undefined ? {} : { note })}
      legend={legend}
      table={{
        columns: [
          axes.along,
          ...lines.map(({ label }) => `${label} [${axes.unit}]`),
          ...bands.flatMap(({ label }) => [text.run.low, text.run.high].map((end) => `${label}, ${end}`)),
        ],
        rows: along.map((length, i) => [
          Number(length.toFixed(2)),
          ...lines.map(({ values }) => {
            const value = values[i] ?? Number.NaN;
            return Number.isFinite(value) ? value : null;
          }),
          ...bands.flatMap((band) => (band.ends[i] ?? []).map((end) => (Number.isFinite(end) ? end : null))),
        ]),
      }}
    >
      {(width) => {
        const [left, right, bottom] = [56, width - 12, HEIGHT - 48];
        const x = linear(0, along.at(-1) ?? 1, left, right, width < 500 ? 3 : 6);
        const y = linear(0, most, bottom, 28);
        const tap = (event: MouseEvent & { currentTarget: SVGRectElement }) => {
          const box = event.currentTarget.getBoundingClientRect();
          choose(nearest(along, event.clientX - box.left + left, x));
        };
        return (
          <Chart width={width} height={HEIGHT} label={title}>
            <LeftAxis scale={y} left={left} right={right} format={plainTick(y.ticks)} unit={axes.value} />
            <BottomAxis
              scale={x}
              top={bottom}
              bottom={bottom + 4}
              right={right}
              format={plainTick(x.ticks)}
              unit={axes.alongUnit}
            />
            {bands.map((band) => (
              <path class={`band ${band.mark}`} d={area(along, band.ends, x, y)} />
            ))}
            {/* The first one, which is dashed, lies above the others: it is seen where they are the same. */}
            {lines.toReversed().map(({ mark, values }) => (
              <path class={`line ${mark}`} d={polyline(along, values, x, y)} />
            ))}
            <line class="chosen" x1={x(along[chosen] ?? 0)} x2={x(along[chosen] ?? 0)} y1={28} y2={bottom} />
            <rect
              class="hit"
              x={left}
              y={28}
              width={Math.max(1, right - left)}
              height={bottom - 28}
              onClick={tap}
              onPointerMove={(event) => event.buttons === 1 && tap(event)}
            />
          </Chart>
        );
      }}
    </Figure>
  );
}

type Place = (value: number) => number;

const plainTick =
  (ticks: number[]): ((value: number) => string) =>
  (value) =>
    value.toFixed(
      Math.min(6, Math.max(0, -Math.floor(Math.log10(Math.abs((ticks[1] ?? 1) - (ticks[0] ?? 0)) || 1) + 1e-9))),
    );

/** The point of the path that is drawn nearest to a place of the axis. */
function nearest(along: number[], at: number, x: Place): number {
  let best = 0;
  along.forEach((length, i) => {
    if (Math.abs(x(length) - at) < Math.abs(x(along[best] ?? 0) - at)) best = i;
  });
  return best;
}

/** A line through the points that have a value. */
export function polyline(along: number[], values: number[], x: Place, y: Place): string {
  let drawing = false;
  return values
    .map((value, i) => {
      const there = Number.isFinite(value);
      const step = there ? `${drawing ? "L" : "M"}${x(along[i] ?? 0).toFixed(1)},${y(value).toFixed(1)}` : "";
      drawing = there;
      return step;
    })
    .join("");
}

/** The area between both ends of an interval, over the points that have one. */
function area(along: number[], ends: (readonly [number, number])[], x: Place, y: Place): string {
  const known = ends.flatMap(([low, high], i) =>
    Number.isFinite(low) && Number.isFinite(high) ? [{ at: x(along[i] ?? 0), low: y(low), high: y(high) }] : [],
  );
  if (known.length === 0) return "";
  const upper = known.map(({ at, high }) => `${at.toFixed(1)},${high.toFixed(1)}`);
  const lower = known.map(({ at, low }) => `${at.toFixed(1)},${low.toFixed(1)}`).reverse();
  return `M${[...upper, ...lower].join("L")}Z`;
}
