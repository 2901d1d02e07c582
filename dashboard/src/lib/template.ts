/** Templates of imports: the options by which files of the same form are read again. */
import type { ImportAnswer, ImportOptions } from "../api/types";
import { isFields, parsed } from "./json";

export interface Template {
  /** Of the file it was made of. */
  name: string;
  options: ImportOptions;
}

/** As many are kept. */
const MOST = 20;

/** Whether files have the headers that a template was made of. */
export function fits(template: Template, preview: ImportAnswer["preview"]): boolean {
  const layouts = new Set((template.options.layouts ?? []).map((layout) => JSON.stringify(layout)));
  const read = preview.files.map((file) => JSON.stringify(file.columns.map((column) => column.header)));
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
