/** Documents as files and forms have them, the faults of requests at their fields, and keys for posting safely. */
import type { Problem } from "../api/types";

export type Fields = Record<string, unknown>;

/** Items by a key, in their order. Not `Map.groupBy`: tablets of a shop floor have browsers of before 2024. */
export function groupedBy<T, K>(items: Iterable<T>, keyOf: (item: T) => K): Map<K, T[]> {
  const groups = new Map<K, T[]>();
  for (const item of items) {
    const key = keyOf(item);
    groups.set(key, [...(groups.get(key) ?? []), item]);
  }
  return groups;
}

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

/** The objects of a list; none of anything else. */
export const listOf = (value: unknown): Fields[] => (Array.isArray(value) ? value.filter(isFields) : []);

/** A text that is no value of its field: posted as it was typed, so that the service names the field. */
export interface Unread {
  unread: string;
}

export const isUnread = (value: unknown): value is Unread => isFields(value) && typeof value["unread"] === "string";

/** What stands in a document as it was typed because it was not understood; null if there is nothing. */
export function unreadIn(document: unknown): string | null {
  if (isUnread(document)) return document.unread;
  const parts = typeof document === "object" && document !== null ? Object.values(document) : [];
  return parts.map(unreadIn).find((found) => found !== null) ?? null;
}

/** The text of a document that is posted. */
export const jsonOf = (document: unknown): string =>
  JSON.stringify(document, (_, part) => (isUnread(part) ? part.unread : part));

/** A document without fields that state nothing, at any depth; lists keep their parts. */
export const stated = (value: unknown): unknown =>
  isFields(value)
    ? Object.fromEntries(
        Object.entries(value)
          .filter(([, part]) => (part ?? "") !== "")
          .map(([name, part]) => [name, stated(part)]),
      )
    : value;

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

interface Fault {
  where: string;
  reason: string;
  remedy?: string | null;
}

/** All faults of a problem, also where it has but one. */
export function faultsOf({ errors, where, detail, remedy }: Problem): Fault[] {
  return errors && errors.length > 0 ? errors : [{ where: where ?? "", reason: detail, remedy: remedy ?? null }];
}

const within = (where: string, path: string): boolean =>
  where === path || where.startsWith(`${path}.`) || where.startsWith(`${path}[`);

/** Reasons whose place is `path` or within it, each once and with its remedy. */
export function faultsAt(problem: Problem | null, path: string): string[] {
  if (!problem) return [];
  const here = faultsOf(problem).filter(({ where }) => within(where, path));
  return [...new Set(here.map(({ reason, remedy }) => (remedy ? `${reason}: ${remedy}` : reason)))];
}

/** A problem without the faults that stand at their fields already. */
export function elsewhere(problem: Problem, paths: string[]): Problem {
  const errors = (problem.errors ?? []).filter(({ where }) => !paths.some((path) => within(where, path)));
  const said = paths.some((path) => within(problem.where ?? "", path));
  return { ...problem, errors, ...(said ? { where: null, remedy: null } : {}) };
}

/**
 * A hash of a text, FNV-1a of 128 bits. Not cryptographic, as `crypto.subtle` is absent on plain http; the service
 * refuses a key that comes again with another body, so that a collision is an error and never another robot.
 */
export function contentKey(kind: string, content: unknown): string {
  let hash = 0x6c62272e07bb014262b821756295c58dn;
  for (const byte of new TextEncoder().encode(JSON.stringify(content)))
    hash = BigInt.asUintN(128, (hash ^ BigInt(byte)) * 0x1000000000000000000013bn);
  return `${kind}-${hash.toString(36)}`;
}

/** A key that no other post has. */
export function freshKey(kind: string): string {
  const numbers = crypto.getRandomValues(new Uint32Array(4));
  return `${kind}-${[...numbers].map((n) => n.toString(36)).join("")}`;
}
