/** Documents as files have them. */

export type Fields = Record<string, unknown>;

/** What a JSON text says, with or without a byte order mark; undefined if it is none. */
export function parsed(content: string): unknown {
  try {
    return JSON.parse(content.replace(/^\ufeff/, ""));
  } catch {
    return undefined;
  }
}

export const isFields = (value: unknown): value is Fields =>
  typeof value === "object" && value !== null && !Array.isArray(value);

/** A document without fields that state nothing, at any depth; lists keep their parts. */
export const stated = (value: unknown): unknown =>
  isFields(value) && value.constructor === Object
    ? Object.fromEntries(
        Object.entries(value)
          .filter(([, part]) => (part ?? "") !== "")
          .map(([name, part]) => [name, stated(part)]),
      )
    : value;

export const entriesOf = <Key extends string, Value>(of: { [key in Key]: Value }): [Key, Value][] =>
  Object.entries(of) as [Key, Value][];

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
