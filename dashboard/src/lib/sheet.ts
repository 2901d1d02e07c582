/** A sheet of a job as JSON, column by column: `map.json`, `points.json`. */

export interface Columns {
  /** Null where there is no number. */
  columns: { name: string; unit: string; values: (number | string | null)[] }[];
}

export const numeric = (value: unknown): number => (typeof value === "number" ? value : Number.NaN);

/** Columns by their headers, such as `force x [N]`, and their numbers: NaN where there is none. */
export function readerOf({ columns }: Columns) {
  const byHead = new Map(columns.map(({ name, unit, values }) => [unit ? `${name} [${unit}]` : name, values]));
  const column = (head: string): (number | string | null)[] => byHead.get(head) ?? [];
  return { column, numbers: (head: string, row: number): number => numeric(byHead.get(head)?.[row]) };
}
