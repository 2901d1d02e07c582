/** The frame of every chart: title, note, legend, axes, and folded away the table behind it; charts by configuration, a path a series. */
import { type Scale, extent, linear, significant } from "../lib/format";
import { type ComponentChildren, render } from "preact";
import { useRef, useState } from "preact/hooks";
import { DataTable, heading, type Table, save, standalone, csv, fileName, alike } from "../components/table";
import { useWidth, Button, tip } from "../components/basics";
import { text } from "../words";

interface AxisProps {
  scale: Scale;
  right: number;
  format: (value: number) => string;
  unit: string;
}

export function BottomAxis({ scale, top, bottom, format, unit, right }: AxisProps & { top: number; bottom: number }) {
  return (
    <g class="axis">
      {scale.ticks.map((tick) => (
        <g>
          <line x1={scale(tick)} x2={scale(tick)} y1={top} y2={bottom} />
          <text x={scale(tick)} y={bottom + 20} text-anchor="middle">
            {format(tick)}
          </text>
        </g>
      ))}
      <text class="unit" x={right} y={bottom + 42} text-anchor="end">
        {unit}
      </text>
    </g>
  );
}

export function LeftAxis({ scale, left, right, format, unit }: AxisProps & { left: number }) {
  return (
    <g class="axis">
      {scale.ticks.map((tick) => (
        <g>
          <line x1={left} x2={right} y1={scale(tick)} y2={scale(tick)} class={tick === 0 ? "zero" : undefined} />
          <text x={left - 8} y={scale(tick) + 5} text-anchor="end">
            {format(tick)}
          </text>
        </g>
      ))}
      <text class="unit" x={4} y={15}>
        {unit}
      </text>
    </g>
  );
}

interface NamesProps {
  names: string[];
  place: (index: number) => number;
  bottom: number;
  room: number;
}

/** Names along the bottom, thinned out until they fit. */
export function Names({ names, place, bottom, room }: NamesProps) {
  const every = Math.max(1, Math.ceil((names.length * 44) / Math.max(1, room)));
  return (
    <g class="axis">
      {names.map(
        (name, i) =>
          i % every === 0 && (
            <text x={place(i)} y={bottom + 20} text-anchor="middle">
              {name.length > 5 ? `${name.slice(0, 4)}…` : name}
            </text>
          ),
      )}
    </g>
  );
}

interface LegendItem {
  label: string;
  /** Class of the mark, see the style sheet. */
  mark: string;
  /** Choose what is drawn so; none: there is nothing to choose. */
  choose?: () => void;
  chosen?: boolean;
}

interface FigureProps {
  title: string;
  note?: string;
  legend?: LegendItem[];
  /** What is drawn, where no table of the page has its numbers. */
  table?: Table;
  /** What is downloaded, with all digits, where the table shows estimates. */
  file?: Table;
  /** Draws the chart for a width in pixels. */
  children: (width: number) => ComponentChildren;
  tools?: ComponentChildren;
  /** What is downloaded where the page shows a table with marks in it; null for nothing. */
  drawing?: ((width: number) => ComponentChildren) | null;
}

/** What the view is about, as the browser's tab names it: files of two views do not have one name. */
const subject = (): string => document.title.replace(` · ${text.app.name}`, "");

export function Figure({ title, note, legend = [], table, file = table, children, tools, drawing }: FigureProps) {
  const [box, width] = useWidth<HTMLDivElement>();
  const figure = useRef<HTMLElement>(null);
  const [open, setOpen] = useState(false); // a table of hundreds of rows is made when it is looked at
  const saveSvg = () => {
    const drawn = drawing && drawnAside(figure.current, drawing(SAVED_WIDTH));
    const svg = (drawn ?? figure.current)?.querySelector<SVGSVGElement>("svg.chart");
    if (svg) save(standalone(svg, title), "image/svg+xml", fileName(`${subject()} ${title}`, "svg"));
    drawn?.remove();
  };
  const svg = (
    <Button look="quiet" onClick={saveSvg} aria-label={text.figure.download("SVG", title)}>
      {text.figure.svg}
    </Button>
  );
  return (
    <figure class="figure" ref={figure}>
      <figcaption>
        <div>
          <h2>{title}</h2>
        </div>
        {tools && <div class="tools">{tools}</div>}
      </figcaption>
      <div class="drawing" ref={box}>
        {width > 0 && children(width)}
      </div>
      {legend.length > 0 && <Legend items={legend} />}
      {note !== undefined && !drawing && <p class="soft">{note}</p>}
      {table && file ? (
        <details onToggle={(event) => setOpen(event.currentTarget.open)}>
          <summary>{text.figure.table}</summary>
          {open && <DataTable table={table} caption={title} />}
          <div class="actions">
            <Button
              look="quiet"
              onClick={() =>
                save(csv(file.columns.map(heading), file.rows), "text/csv", fileName(`${subject()} ${title}`, "csv"))
              }
              aria-label={text.figure.download("CSV", title)}
            >
              {text.figure.csv}
            </Button>
            {svg}
          </div>
        </details>
      ) : drawing === null ? null : (
        <details>
          <summary>{text.app.further}</summary>
          {drawing && note !== undefined && <p class="soft">{note}</p>}
          <div class="actions">{svg}</div>
        </details>
      )}
    </figure>
  );
}

export const Legend = ({ items }: { items: LegendItem[] }) => (
  <ul class="legend">
    {items.map(({ mark, label, choose, chosen = false }) => (
      <li>
        {choose ? (
          <button type="button" class="chooses" aria-pressed={chosen} onClick={choose}>
            <i class={`mark ${mark}`} aria-hidden="true" />
            <bdi>{label}</bdi>
          </button>
        ) : (
          <>
            <i class={`mark ${mark}`} aria-hidden="true" />
            {label}
          </>
        )}
      </li>
    ))}
  </ul>
);

const SAVED_WIDTH = 1000;

/** Draw where no one looks, but where the style sheet holds. */
function drawnAside(beside: HTMLElement | null, drawing: ComponentChildren): HTMLElement {
  const box = document.createElement("div");
  box.className = "hidden";
  beside?.append(box);
  render(<>{drawing}</>, box);
  return box;
}

interface ChartProps {
  width: number;
  height: number;
  label: string;
  /** Whether marks in it are links, which a picture would hide. */
  links?: boolean;
  children: ComponentChildren;
}

/** The drawing itself: a picture with a name for those who do not see it. */
export function Chart({ width, height, label, links = false, children }: ChartProps) {
  return (
    <svg
      class="chart"
      role={links ? "group" : "img"}
      aria-label={label}
      width={width}
      height={height}
      viewBox={`0 0 ${width} ${height}`}
    >
      {children}
    </svg>
  );
}

export interface Series extends LegendItem {
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

interface BarFigureProps {
  title: string;
  note: string;
  names: string[];
  series: Series[];
  unit: string;
  stacked?: boolean;
  /** What the names are, in the table. */
  named?: string;
}

/** Bars for the first series, narrower ones inside for the second, dots for the others; or all of them stacked. */
export function BarFigure({
  title,
  note,
  names,
  series,
  unit,
  stacked = false,
  named = text.figure.configuration,
  ...opening
}: BarFigureProps & Opening) {
  if (names.length === 0) return null;
  const value = (one: Series, i: number) => one.values[i] ?? null;
  const heights = stacked ? stacks(names, series) : series.flatMap(({ values }) => values.filter((v) => v !== null));
  const lines = (i: number) =>
    series.flatMap((one) => {
      const height = value(one, i);
      return height === null ? [] : [`${one.label}: ${significant(height, 3)} ${unit}`];
    });
  const labels = series.map((one) => one.label);
  const oneIsChosen = series.some(({ chosen }) => chosen);
  const columns = [named, ...alike(labels, unit)];
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
              const isBehind = oneIsChosen && !one.chosen;
              return <path class={isBehind ? `bars ${one.mark} behind` : `bars ${one.mark}`} d={shapes.join("")} />;
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
