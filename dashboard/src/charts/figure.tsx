/** The frame of every chart: title, note, legend, axes, and folded away the table behind it with its downloads. */
import type { Scale } from "../lib/scale";
import { type ComponentChildren, render } from "preact";
import { useRef, useState } from "preact/hooks";
import { DataTable, heading, type Table, save, standalone, csv, fileName } from "../components/table";
import { useWidth, Button } from "../components/basics";
import { text } from "../i18n";

export function BottomAxis({
  scale,
  top,
  bottom,
  format,
  unit,
  right,
}: {
  scale: Scale;
  top: number;
  bottom: number;
  format: (value: number) => string;
  unit: string;
  right: number;
}) {
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

export function LeftAxis({
  scale,
  left,
  right,
  format,
  unit,
}: {
  scale: Scale;
  left: number;
  right: number;
  format: (value: number) => string;
  unit: string;
}) {
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

/** Names along the bottom, thinned out until they fit. */
export function Names({
  names,
  place,
  bottom,
  room,
}: {
  names: string[];
  place: (index: number) => number;
  bottom: number;
  room: number;
}) {
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
}

export function Figure({
  title,
  note,
  legend = [],
  table,
  children,
  tools,
  drawing,
}: {
  title: string;
  note?: string;
  legend?: LegendItem[];
  /** What is drawn, where no table of the page has its numbers. */
  table?: Table;
  /** Draws the chart for a width in pixels. */
  children: (width: number) => ComponentChildren;
  tools?: ComponentChildren;
  /** What is downloaded where the page shows a table with marks in it. */
  drawing?: (width: number) => ComponentChildren;
}) {
  const [box, width] = useWidth<HTMLDivElement>();
  const figure = useRef<HTMLElement>(null);
  const [open, setOpen] = useState(false); // a table of hundreds of rows is made when it is looked at
  const saveSvg = () => {
    const drawn = drawing && drawnAside(figure.current, drawing(SAVED_WIDTH));
    const svg = (drawn ?? figure.current)?.querySelector<SVGSVGElement>("svg.chart");
    if (svg) save(standalone(svg, title), "image/svg+xml", fileName(title, "svg"));
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
          <h3>{title}</h3>
        </div>
        {tools && <div class="tools">{tools}</div>}
      </figcaption>
      <div class="drawing" ref={box}>
        {width > 0 && children(width)}
      </div>
      {legend.length > 0 && <Legend items={legend} />}
      {note !== undefined && <p class="soft">{note}</p>}
      {table ? (
        <details onToggle={(event) => setOpen(event.currentTarget.open)}>
          <summary>{text.figure.table}</summary>
          {open && <DataTable table={table} caption={title} />}
          <div class="actions">
            <Button
              look="quiet"
              onClick={() => save(csv(table.columns.map(heading), table.rows), "text/csv", fileName(title, "csv"))}
              aria-label={text.figure.download("CSV", title)}
            >
              {text.figure.csv}
            </Button>
            {svg}
          </div>
        </details>
      ) : (
        <div class="actions">{svg}</div>
      )}
    </figure>
  );
}

export const Legend = ({ items }: { items: LegendItem[] }) => (
  <ul class="legend">
    {items.map(({ mark, label }) => (
      <li>
        <i class={`mark ${mark}`} aria-hidden="true" />
        {label}
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

/** The drawing itself: a picture with a name for those who do not see it. */
export function Chart({
  width,
  height,
  label,
  links = false,
  children,
}: {
  width: number;
  height: number;
  label: string;
  /** Whether marks in it are links, which a picture would hide. */
  links?: boolean;
  children: ComponentChildren;
}) {
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
