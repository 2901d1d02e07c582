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
