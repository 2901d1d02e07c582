/** The frame of every chart: title, note, legend, downloads, and the table behind it. */
import type { ComponentChildren } from "preact";
import { useRef } from "preact/hooks";
import { DataTable, heading, type Table } from "../parts/table";
import { save, standalone } from "../parts/download";
import { csv, fileName } from "../pure/csv";
import { useWidth } from "../state/size";
import { text } from "../text";

export interface LegendItem {
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
}: {
  title: string;
  note?: string;
  legend?: LegendItem[];
  table: Table;
  /** Draws the chart for a width in pixels. */
  children: (width: number) => ComponentChildren;
  tools?: ComponentChildren;
}) {
  const [box, width] = useWidth<HTMLDivElement>();
  const figure = useRef<HTMLElement>(null);
  const saveSvg = () => {
    const svg = figure.current?.querySelector<SVGSVGElement>("svg.chart");
    if (svg) save(standalone(svg, title), "image/svg+xml", fileName(title, "svg"));
  };
  const saveCsv = () => save(csv(table.columns.map(heading), table.rows), "text/csv", fileName(title, "csv"));
  return (
    <figure class="figure" ref={figure}>
      <figcaption>
        <div>
          <h3>{title}</h3>
          {note !== undefined && <p>{note}</p>}
        </div>
        <div class="tools">
          {tools}
          <button type="button" class="button quiet" onClick={saveCsv} aria-label={text.figure.download("CSV", title)}>
            {text.figure.csv}
          </button>
          <button type="button" class="button quiet" onClick={saveSvg} aria-label={text.figure.download("SVG", title)}>
            {text.figure.svg}
          </button>
        </div>
      </figcaption>
      {legend.length > 0 && (
        <ul class="legend">
          {legend.map((item) => (
            <li>
              <i class={`mark ${item.mark}`} aria-hidden="true" />
              {item.label}
            </li>
          ))}
        </ul>
      )}
      <div class="drawing" ref={box}>
        {width > 0 && children(width)}
      </div>
      <details>
        <summary>{text.figure.table}</summary>
        <DataTable table={table} caption={title} />
      </details>
    </figure>
  );
}

/** The drawing itself: a picture with a name for those who do not see it. */
export function Chart({
  width,
  height,
  label,
  children,
}: {
  width: number;
  height: number;
  label: string;
  children: ComponentChildren;
}) {
  return (
    <svg class="chart" role="img" aria-label={label} width={width} height={height} viewBox={`0 0 ${width} ${height}`}>
      {children}
    </svg>
  );
}
