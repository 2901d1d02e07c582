/** The frame of every chart: title, note, legend, and folded away the table behind it with its downloads. */
import { type ComponentChildren, render } from "preact";
import { useRef, useState } from "preact/hooks";
import { DataTable, heading, type Table } from "../components/table";
import { save, standalone } from "../components/download";
import { csv, fileName } from "../lib/csv";
import { useWidth } from "../state/size";
import { text } from "../i18n";
import { Button } from "../components/basics";

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
