/** Tables of readings: the meanings of their columns in the words that the service says and takes, and templates by which they are read again. */
import type { ImportAnswer, ImportOptions } from "../../api/types";
import { isFields, parsed } from "../../lib/json";

export type FilePreview = ImportAnswer["files"][number];
export type ColumnMeaning = FilePreview["columns"][number];
export type ImportFault = ImportAnswer["faults"][number];
type Dimension = keyof typeof UNITS;

export const UNITS = {
  length: ["mm", "m", "in"],
  angle: ["deg", "rad"],
  force: ["N", "daN", "kN", "kgf", "lbf"],
  moment: ["N.m", "N.mm", "kN.m", "kgf.m", "lbf.ft", "lbf.in"],
} as const;

export const UNKNOWN = "unknown";
const IGNORED = "ignored";
const AXES = ["x", "y", "z"];
const LEAST_JOINTS = 6;
const MOST_DEGREES = 720;

/** The unknown columns that may be joints of a robot that is not chosen yet: by their unit, or by their numbers. */
export function maybeJoints({ columns, first_rows }: Pick<FilePreview, "columns" | "first_rows">): ColumnMeaning[] {
  const isAngle = (cell: string | undefined) => {
    const number = Number((cell ?? "").replace(",", "."));
    return cell !== undefined && cell.trim() !== "" && Math.abs(number) <= MOST_DEGREES;
  };
  return columns.filter(({ column, header, meaning }) => {
    if (meaning !== UNKNOWN) return false;
    const unit = /[[(]([^\])]*)[\])]\s*$/.exec(header)?.[1]?.toLowerCase();
    if (unit !== undefined) return ["deg", "°", "rad", "grad"].includes(unit);
    return first_rows.length > 0 && first_rows.every((row) => isAngle(row[column - 1]));
  });
}

/** The dimension of a column's numbers; null of texts. */
export function dimensionOf(meaning: string): Dimension | null {
  if (/^joint \d+$/.test(meaning)) return "angle";
  if (/^force [xyz]$/.test(meaning)) return "force";
  if (/^moment [xyz]$/.test(meaning)) return "moment";
  return / ([xyz]|U95)$/.test(meaning) || meaning === "U95" ? "length" : null;
}

export interface MeaningGroup {
  group: "texts" | "joints" | "loads" | "target";
  /** Of a target its name. */
  name: string;
  meanings: string[];
}

/** What a column can be chosen to mean: what a campaign has, with the targets that are known and one more. */
export function meaningsFor(files: FilePreview[], targets: string[]): MeaningGroup[] {
  const current = files.flatMap((file) => file.columns.map((column) => column.meaning));
  const joints = current.filter((meaning) => meaning.startsWith("joint ")).length + 1;
  const named = [...new Set([...targets, ...current.flatMap(targetOf)])];
  const next = nextTarget(named);
  return [
    { group: "texts", name: "", meanings: [IGNORED, "name", "target", "state", "collection", "group"] },
    {
      group: "joints",
      name: "",
      meanings: Array.from({ length: Math.max(LEAST_JOINTS, joints) }, (_, j) => `joint ${j + 1}`),
    },
    {
      group: "loads",
      name: "",
      meanings: ["force", "moment", "load point"].flatMap((kind) => AXES.map((axis) => `${kind} ${axis}`)),
    },
    ...[...named, next].map((name) => ({ group: "target" as const, name, meanings: positionsOf(name) })),
    { group: "target", name: "", meanings: AXES.map((axis) => `position ${axis}`) },
  ];
}

const positionsOf = (target: string): string[] =>
  ["unloaded", "loaded", "unloaded after", "deflection"].flatMap((state) =>
    AXES.map((axis) => `${target} ${state} ${axis}`),
  );

function targetOf(meaning: string): string[] {
  const [, target] = /^(.+) (?:unloaded after|unloaded|loaded|deflection) [xyz]$/.exec(meaning) ?? [];
  return target === undefined ? [] : [target];
}

function nextTarget(known: string[]): string {
  let number = 1;
  while (known.includes(`T${number}`)) number += 1;
  return `T${number}`;
}

/** The header of a column as it stands in the file; empty where there is none, or where the options give one. */
export const writtenHeader = (options: ImportOptions, column: ColumnMeaning): string =>
  (options.header ?? []).length > 0 ? "" : column.header;

/** The options by which a column is read as something else. */
export function withMeaning(options: ImportOptions, file: FilePreview, index: number, meaning: string): ImportOptions {
  const column = file.columns[index];
  const header = column ? writtenHeader(options, column) : "";
  if (header !== "") return { ...options, columns: { ...options.columns, [header]: sent(meaning) } };
  const headers = file.columns.map((one, i) => sent(i === index ? meaning : one.meaning));
  return { ...options, header: headers };
}

/** The options by which columns are not used. */
export const withoutColumns = (options: ImportOptions, file: FilePreview, columns: ColumnMeaning[]): ImportOptions =>
  columns.reduce((before, { column }) => withMeaning(before, file, column - 1, IGNORED), options);

const sent = (meaning: string): string => (meaning === IGNORED ? "ignore" : meaning);

/** The line of a header's cells among the lines of a table. */
export const HEADER = 0;

/** Where a fault stands among the lines that are shown, as `line:column`; null for elsewhere. */
export function cellOf(file: FilePreview, { line, column }: ImportFault, shown: number[]): string | null {
  if (column === null) return null;
  if (line === null || file.header_lines.includes(line)) return `${HEADER}:${column}`;
  return shown.includes(line) ? `${line}:${column}` : null;
}

/** A fault and its remedy in one sentence. */
export const said = ({ reason, remedy }: ImportFault): string => `${reason}: ${remedy}`;

/** The number of cells in the first row of a text, by the mark that parts it most; what is quoted parts none. */
export function widthOf(content: string): number {
  const rows = content.split(/\r\n|\r|\n/).map((line) => line.trim());
  const first = rows.find((line) => line !== "" && !/^(#|\/\/|%)/.test(line)) ?? "";
  const mark = ["\t", ";", ","].find((each) => first.includes(each));
  if (mark === undefined) return first.match(/"(?:[^"]|"")*"|\S+/g)?.length ?? 0;
  return [...`${mark}${first}`.matchAll(new RegExp(`${mark}("(?:[^"]|"")*"|[^${mark}]*)`, "g"))].length;
}

export interface Template {
  /** Of the file it was made of. */
  name: string;
  options: ImportOptions;
}

/** As many are kept. */
const MOST = 20;

/** Whether files have the headers that a template was made of. */
export function fits(template: Template, { files }: Pick<ImportAnswer, "files">): boolean {
  const layouts = new Set((template.options.layouts ?? []).map((layout) => JSON.stringify(layout)));
  const read = files.map((file) => JSON.stringify(file.columns.map((column) => column.header)));
  return layouts.size > 0 && read.length > 0 && read.every((layout) => layouts.has(layout));
}

/** The templates with a new one in front, which takes the place of one for the same headers. */
export function withTemplate(templates: Template[], added: Template): Template[] {
  const layouts = JSON.stringify(added.options.layouts ?? []);
  const others = templates.filter(({ options }) => JSON.stringify(options.layouts ?? []) !== layouts);
  return [added, ...others].slice(0, MOST);
}

/** A template from a JSON file; null if the file is something else. */
export function templateIn(name: string, content: string): Template | null {
  const document = parsed(content);
  if (!isFields(document)) return null;
  const known = ["layouts", "columns", "units"].filter((key) => key in document);
  const other = ["observations", "measurement_set", "robot", "sweeps"].some((key) => key in document);
  return known.length > 0 && !other ? { name, options: document as ImportOptions } : null;
}

/** Templates as they were kept; none if that cannot be read. */
export function templatesIn(list: unknown): Template[] {
  if (!Array.isArray(list)) return [];
  return list.filter(
    (one) => typeof one?.name === "string" && typeof one?.options === "object" && one.options !== null,
  );
}
