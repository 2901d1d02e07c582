/** Fields of requests as the service describes them, and how their values are typed: text to JSON and back. */

/** The number of a text, with a decimal point or comma; null of an empty text, NaN of anything else. */
export function numberIn(text: string): number | null {
  const trimmed = text.trim().replace("\u2212", "-");
  if (trimmed === "") return null;
  const value = Number(trimmed.replace(",", "."));
  return /^[-+]?(\d+([.,]\d*)?|[.,]\d+)(e[-+]?\d+)?$/i.test(trimmed) && Number.isFinite(value) ? value : Number.NaN;
}

/**
 * Whether a text has a number that some read as thousands and others as a fraction: 1,500 or 1.500. It may be one of a
 * list, and its mark a separator: -1.500, 0, 0 and 1,500,0.
 */
export const isAmbiguous = (text: string): boolean => /(?<![\d.])[1-9]\d{0,2}[.,]\d{3}(?!\d)/.test(text);

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

/** Numbers at any depth times a factor; what is no number stays as it is. */
export const sized = <Value>(value: Value, factor: number): Value =>
  (Array.isArray(value)
    ? value.map((part) => sized(part, factor))
    : typeof value === "number"
      ? scaled(value, factor)
      : value) as Value;

export interface Schema {
  type?: string | undefined;
  enum?: string[];
  const?: string;
  default?: unknown;
  description?: string;
  /** Of its numbers. */
  unit?: string;
  unit_of_prismatic?: string;
  anyOf?: Schema[];
  oneOf?: Schema[];
  properties?: Record<string, Schema>;
  items?: Schema;
  prefixItems?: Schema[];
  additionalProperties?: Schema;
  maxLength?: number;
  /** Whether null is a value. */
  nullable?: boolean;
  $ref?: string;
}

export type Schemas = Record<string, Schema>;

/** A schema without references; of a value that may be null, that of the others. */
export function plain(schema: Schema, all: Schemas): Schema {
  const { $ref, anyOf, ...own } = schema;
  if ($ref) return { ...plain(all[$ref.split("/").at(-1) ?? ""] ?? {}, all), ...own };
  const [first, ...others] = (anyOf ?? []).filter(({ type }) => type !== "null");
  if (!first || others.length > 0) return schema;
  return { ...plain(first, all), ...own, nullable: (anyOf ?? []).length > 1 };
}

/** How a value is typed in one box. */
export interface Codec {
  show: (value: unknown) => string;
  /** Null of an empty text, undefined of one that is not understood. */
  read: (typed: string) => unknown;
  /** Whether it takes several lines. */
  lines?: boolean;
  /** Whether it is a list, which may be longer than a line. */
  isList?: boolean;
}

const ofNumber = (factor: number): Codec => ({
  show: (value) => (typeof value === "number" ? String(scaled(value, 1 / factor)) : String(value ?? "")),
  read: (typed) => {
    const value = numberIn(typed);
    return value === null ? null : Number.isNaN(value) ? undefined : scaled(value, factor);
  },
});

export const OF_TEXT: Codec = { show: (value) => String(value ?? ""), read: (typed) => typed.trim() || null };

/** Values in a row, parted by blanks, commas or semicolons. */
const ofList = (inner: Codec, count?: number): Codec => ({
  isList: true,
  show: (value) => (Array.isArray(value) ? value.map(inner.show).join(", ") : String(value ?? "")),
  read: (typed) => {
    const bare = typed.trim().replace(/^[([]|[)\]]$/g, "");
    const marks = inner === OF_TEXT && /[,;]/.test(bare) ? /\s*[,;]\s*/ : /\s*;\s*|\s*,\s+|\s+/; // names may have blanks
    const words = bare.split(marks).filter(Boolean);
    const values = (words.length === 1 ? bare.split(",") : words).map(inner.read);
    if (words.length === 0) return null;
    const understood = values.every((value) => value !== null && value !== undefined);
    return understood && (count === undefined || count === values.length) ? values : undefined;
  },
});

export const OF_NUMBER = ofNumber(1);
export const OF_NUMBERS = ofList(OF_NUMBER);
export const OF_VECTOR = ofList(OF_NUMBER, 3);

/** Numbers in a row; null of an empty text, undefined of anything else. */
export const listIn = (text: string) => OF_NUMBERS.read(text) as number[] | null | undefined;

/** Three numbers in a row. */
export const vectorIn = (text: string) => OF_VECTOR.read(text) as [number, number, number] | null | undefined;

/** A value a line, after its name where they have names. */
const ofLines = (inner: Codec, named: boolean): Codec => ({
  show: (value) =>
    typeof value === "object" && value !== null
      ? Object.entries(value)
          .map(([name, part]) => (named ? `${name} ${inner.show(part)}` : inner.show(part)))
          .join("\n")
      : String(value ?? ""),
  read: (typed) => {
    const lines = typed.split("\n").filter((line) => line.trim());
    const read = lines.map((line): [string, unknown] => {
      const [name = ""] = named ? line.trim().split(/[\s;,]+/) : [];
      const rest = line
        .trim()
        .slice(name.length)
        .replace(/^[\s;,]+/, "");
      return [name, inner.read(rest)];
    });
    if (lines.length === 0) return null;
    if (read.some(([, value]) => value === null || value === undefined)) return undefined;
    return named ? Object.fromEntries(read) : read.map(([, value]) => value);
  },
  lines: true,
});

/** How a value of a schema without references is typed, its numbers in a unit of `factor`; null if not in one box. */
export function codecOf(schema: Schema, all: Schemas, factor = 1): Codec | null {
  if (schema.type === "string") return OF_TEXT;
  if (schema.type === "number" || schema.type === "integer") return ofNumber(factor);
  const part = schema.additionalProperties ?? schema.prefixItems?.[0] ?? schema.items;
  const inner = part ? codecOf(plain(part, all), all, factor) : null;
  if (!part || !inner || inner.lines) return null;
  if (schema.additionalProperties) return ofLines(inner, true);
  return plain(part, all).type === "array" ? ofLines(inner, false) : ofList(inner, schema.prefixItems?.length);
}
