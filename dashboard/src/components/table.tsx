/** Tables of numbers, scrollable on their own where they are wide; as CSV and other files that the page makes itself. */
import type { ComponentChildren, VNode } from "preact";
import { significant } from "../lib/format";
import { NameLink } from "./basics";

export type Cell = string | number | null | undefined | VNode;

const FORMULA = /^[\s]*[=+\-@＝＋－＠\t\r|%]/;

/** One field: numbers as they are, text guarded against formulas and quoted where needed; marks are for the page alone. */
export function csvCell(cell: Cell): string {
  if (cell === null || typeof cell === "object" || cell === undefined) return "";
  if (typeof cell === "number") return Number.isFinite(cell) ? String(cell) : "";
  const guarded = FORMULA.test(cell) ? `'${cell}` : cell;
  return /["',;\r\n\t]/.test(guarded) ? `"${guarded.replaceAll('"', '""')}"` : guarded;
}

/** A whole table, with a byte order mark so that spreadsheets read it as UTF-8. */
export function csv(head: string[], rows: Cell[][]): string {
  return `\ufeff${[head, ...rows].map((row) => row.map(csvCell).join(",")).join("\r\n")}\r\n`;
}

/** A file name of what is safe in any file system. */
export function fileName(title: string, extension: string): string {
  const plain = title
    .normalize("NFKD")
    .replace(/[^A-Za-z0-9._-]+/g, "-")
    .replace(/^[-.]+|[-.]+$/g, "");
  return `${plain.slice(0, 80).toLowerCase() || "jointstiff"}.${extension}`;
}

/** Its title; with the unit, and how a number is shown: the CSV has all its digits; where it leads, and a note. */
export type Column =
  | string
  | { title: string; unit?: string; show?: (value: number) => string; to?: string[]; note?: string | undefined };

export interface Table {
  columns: Column[];
  rows: Cell[][];
  /** Columns of text, where all cells are; the others stand at the right. */
  texts?: number[];
  /** Row and column of cells that must not be used. */
  dim?: [number, number][];
}

export const heading = (column: Column): string =>
  typeof column === "string" ? column : column.unit ? `${column.title} [${column.unit}]` : column.title;

/** Columns alike: of one unit, and shown in one way. */
export const alike = (titles: string[], unit: string | undefined, show?: (value: number) => string): Column[] =>
  titles.map((title) => ({ title, ...(unit ? { unit } : {}), ...(show ? { show } : {}) }));

export function DataTable({ table, caption }: { table: Table; caption: string }) {
  return (
    <Scroll label={caption}>
      <table>
        <caption class="hidden">{caption}</caption>
        <thead>
          <tr>
            {table.columns.map((column, i) => (
              <th scope="col" class={numeric(table, i) ? "number" : undefined}>
                <Head column={column} />
              </th>
            ))}
          </tr>
        </thead>
        <tbody>
          {table.rows.map((row, y) => (
            <tr>
              {row.map((cell, i) => {
                const number = numeric(table, i);
                const isDim = table.dim?.some(([row, column]) => row === y && column === i) ?? false;
                const found = shown(cell, table.columns[i]);
                const content = isDim ? <span class="unusable">{found}</span> : found;
                return i === 0 && !number ? (
                  <th scope="row" class="entry">
                    {content}
                  </th>
                ) : (
                  <td class={number ? "number" : undefined}>{content}</td>
                );
              })}
            </tr>
          ))}
        </tbody>
      </table>
    </Scroll>
  );
}

function Head({ column }: { column: Column }) {
  if (typeof column === "string" || !column.to) return <>{heading(column)}</>;
  return (
    <>
      <NameLink to={column.to}>{column.title}</NameLink>
      {column.note && <small class="soft">{column.note}</small>}
    </>
  );
}

/** A table in a card of its own. */
export function TableCard({ title, note, table }: { title: string; note?: ComponentChildren; table: Table }) {
  return (
    <section class="card">
      <h2>{title}</h2>
      {note && <p class="soft">{note}</p>}
      <DataTable caption={title} table={table} />
    </section>
  );
}

/** Whether a column has numbers; what is missing among them stands where they do. */
const numeric = ({ rows, texts }: Table, column: number): boolean =>
  texts ? !texts.includes(column) : rows.some((row) => typeof row[column] === "number");

/** A box that scrolls sideways by itself, by keyboard too. */
export function Scroll({ label, children }: { label: string; children: ComponentChildren }) {
  return (
    <div class="scroll" tabIndex={0} role="region" aria-label={label}>
      {children}
    </div>
  );
}

function shown(cell: Cell, column: Column | undefined): string | VNode {
  if (cell === null || cell === undefined) return "–";
  const show = typeof column === "object" ? column.show : undefined;
  return typeof cell === "number" ? (show ?? ((value) => significant(value, 4)))(cell) : cell;
}

const STYLED = `fill fill-opacity stroke stroke-width stroke-dasharray stroke-opacity opacity font-size font-weight
  font-family text-anchor dominant-baseline paint-order pointer-events`.split(/\s+/);

export function save(content: string, type: string, name: string): void {
  const address = URL.createObjectURL(new Blob([content], { type }));
  const anchor = document.createElement("a");
  anchor.href = address;
  anchor.download = name;
  document.body.append(anchor);
  anchor.click();
  anchor.remove();
  setTimeout(() => URL.revokeObjectURL(address), 10_000);
}

export const saveJson = (document: unknown, name: string): void =>
  save(JSON.stringify(document, null, 2), "application/json", name);

/** A drawing of the page as a document of its own: what the style sheet says becomes attributes of each element. */
export function standalone(svg: SVGSVGElement, title: string): string {
  const copy = svg.cloneNode(true) as SVGSVGElement;
  copy.setAttribute("xmlns", "http://www.w3.org/2000/svg");
  const [from, to] = [svg.querySelectorAll("*"), copy.querySelectorAll("*")];
  from.forEach((element, i) => settle(element, to[i]));
  copy.removeAttribute("class");
  copy.querySelectorAll("[data-tip]").forEach(spoken);
  const ground = document.createElementNS("http://www.w3.org/2000/svg", "rect");
  ground.setAttribute("width", "100%");
  ground.setAttribute("height", "100%");
  ground.setAttribute("fill", getComputedStyle(svg).getPropertyValue("background-color"));
  const name = document.createElementNS("http://www.w3.org/2000/svg", "title");
  name.textContent = title;
  copy.prepend(name, ground);
  return `<?xml version="1.0" encoding="UTF-8"?>\n${new XMLSerializer().serializeToString(copy)}\n`;
}

/** What the page shows under the pointer becomes a title, which every viewer shows. */
function spoken(mark: Element): void {
  const title = document.createElementNS("http://www.w3.org/2000/svg", "title");
  title.textContent = mark.getAttribute("data-tip");
  mark.prepend(title);
  mark.removeAttribute("data-tip");
  mark.removeAttribute("data-open");
}

function settle(element: Element, copy: Element | undefined): void {
  if (!copy) return;
  const style = getComputedStyle(element);
  for (const property of STYLED) copy.setAttribute(property, style.getPropertyValue(property));
  copy.removeAttribute("class");
}
