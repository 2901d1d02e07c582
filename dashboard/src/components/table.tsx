/** Tables of numbers: right-aligned, in tabular figures, scrollable on their own where they are wide. */
import type { ComponentChildren } from "preact";
import { significant } from "../lib/format";
import type { Cell } from "../lib/csv";

/** Its title; with the unit, and how a number is shown: the CSV has all its digits. */
export type Column = string | { title: string; unit?: string; show?: (value: number) => string };

export interface Table {
  columns: Column[];
  rows: Cell[][];
  /** Columns of text, where all cells are; the others stand at the right. */
  texts?: number[];
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
                {heading(column)}
              </th>
            ))}
          </tr>
        </thead>
        <tbody>
          {table.rows.map((row) => (
            <tr>
              {row.map((cell, i) => {
                const [number, content] = [numeric(table, i), shown(cell, table.columns[i])];
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

function shown(cell: Cell, column: Column | undefined): string {
  if (cell === null || cell === undefined) return "–";
  const show = typeof column === "object" ? column.show : undefined;
  return typeof cell === "number" ? (show ?? ((value) => significant(value, 4)))(cell) : cell;
}
