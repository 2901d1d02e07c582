/** Numbers as people type them into a field. */

/** The number of a text, with a decimal point or comma; null of an empty text, NaN of anything else. */
export function numberIn(text: string): number | null {
  const trimmed = text.trim().replace("\u2212", "-");
  if (trimmed === "") return null;
  const value = Number(trimmed.replace(",", "."));
  return /^[-+]?(\d+([.,]\d*)?|[.,]\d+)(e[-+]?\d+)?$/i.test(trimmed) && Number.isFinite(value) ? value : Number.NaN;
}

/**
 * A field as it is posted: the number times `factor`, or null. What is no number is posted as it was typed, so that the
 * service names its field.
 */
export function posted(text: string, factor = 1): number | string | null {
  const value = numberIn(text);
  if (value === null) return null;
  return Number.isFinite(value) ? scaled(value, factor) : text.trim();
}

/** A product without the digits that only the factor's rounding brings: 0.86 · 1e6 is 860000. */
export const scaled = (value: number, factor: number): number =>
  factor === 1 ? value : Number((value * factor).toPrecision(15));

/** Three numbers, parted by semicolons, blanks or commas; null of an empty text, undefined of anything else. */
export function vectorIn(text: string): [number, number, number] | null | undefined {
  const trimmed = text
    .trim()
    .replace(/^[([]|[)\]]$/g, "")
    .trim();
  if (trimmed === "") return null;
  const parts = trimmed.split(/\s*;\s*|\s*,\s+|\s+/);
  const values = (parts.length === 1 ? trimmed.split(",") : parts).map(numberIn);
  const [x, y, z] = values;
  const three = values.length === 3 && values.every((value) => value !== null && Number.isFinite(value));
  return three ? [x as number, y as number, z as number] : undefined;
}
