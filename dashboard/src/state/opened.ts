/** Files that were dropped or chosen, and what they are: a campaign, tables of readings, or a template for them. */
import { api, problemOf } from "../api/client";
import type { ImportOptions } from "../api/types";
import { type Campaign, notFinite, understand, type Typed, typedOf } from "../lib/campaign";
import type { Fields } from "../lib/json";
import { type Template, templateIn, templatesIn, withTemplate } from "../lib/imports";
import type { FileFault } from "../i18n";
import { keep, kept, recalled, remember } from "./session";

const MAX_BYTES = 8 * 1024 * 1024;

export type Opened =
  | { kind: "campaign"; name: string; campaign: Campaign }
  | { kind: "tables"; files: File[]; template: Template | null }
  | { kind: "template"; template: Template }
  | { kind: "sweeps"; file: File }
  | { kind: "fault"; name: string; fault: FileFault };

/** What was said of tables so far. */
interface Draft {
  options: ImportOptions;
  /** The tracker's, if positions are in its frame. */
  frame: Fields;
  /** What is noted about the measurement. */
  typed: Typed;
}

/** Nothing said yet but what a template says. */
export const freshDraft = (options: ImportOptions): Draft => ({ options, frame: {}, typed: typedOf({}) });

/** Tables that were not identified yet, with what was said of them: one may add a robot meanwhile, or come back. */
let begun: { opened: Opened; draft: Draft | null } | null = null;
/** Where they are kept; what an older page kept as `tables` had other fields. */
const NAME = "files";

export const keptDraft = (files: File[]): Draft | null =>
  begun?.opened.kind === "tables" && begun.opened.files === files ? begun.draft : null;

export function keepDraft(draft: Draft): void {
  if (begun) begun.draft = draft;
  void keep(NAME, begun);
}

export const keptFiles = (): Opened | null => begun?.opened ?? null;

/** What was begun before the page was loaded anew. */
export async function keptBefore(): Promise<Opened | null> {
  begun ??= await kept<NonNullable<typeof begun>>(NAME);
  return keptFiles();
}

export function keepFiles(opened: Opened | null): void {
  begun = opened?.kind === "tables" ? { opened, draft: null } : null;
  void keep(NAME, begun);
}

/** Look at files. A template goes with the tables it comes with, or with those `before` or after it. */
export async function open(files: File[], before: Opened | null): Promise<Opened> {
  const name = files.map((file) => file.name).join(", ");
  const fault = (fault: FileFault): Opened => ({ kind: "fault", name, fault });
  if (files.reduce((sum, file) => sum + file.size, 0) > MAX_BYTES) return fault("too_large");
  const documents: File[] = [];
  const tables: File[] = [];
  for (const file of files) ((await isJson(file)) ? documents : tables).push(file);
  const [document, ...others] = documents;
  if (document === undefined) {
    return { kind: "tables", files: tables, template: before?.kind === "template" ? before.template : null };
  }
  if (others.length > 0) return fault("several");
  const content = await document.text();
  const template = templateIn(document.name, content);
  if (template) {
    const known = tables.length > 0 ? tables : before?.kind === "tables" ? [...before.files] : [];
    return known.length > 0 ? { kind: "tables", files: known, template } : { kind: "template", template };
  }
  if (tables.length > 0) return fault("mixed");
  const campaign = understand(content);
  if (campaign === "sweeps") return { kind: "sweeps", file: document };
  if (campaign === "not_json") return { kind: "fault", name: await mistakeIn(document), fault: campaign };
  if (campaign === "not_finite") return { kind: "fault", name: `${name}: ${notFinite(content)}`, fault: campaign };
  return typeof campaign === "string" ? fault(campaign) : { kind: "campaign", name, campaign };
}

/** Where the JSON of a file is wrong, as the service says it: its name, line and column. */
export const mistakeIn = (file: File): Promise<string> =>
  api.importFiles([file]).then(
    () => file.name,
    (error) => `${file.name}: ${problemOf(error).detail}`,
  );

const isJson = async (file: File): Promise<boolean> =>
  /\.json$/i.test(file.name) || /^\ufeff?\s*[{[]/.test(await file.slice(0, 200).text());

/** A file that another view is to take, once. */
export const handed: { file: File | null } = { file: null };

export const keptTemplates = (): Template[] => templatesIn(recalled("templates"));
export const keepTemplate = (template: Template): void =>
  remember("templates", withTemplate(keptTemplates(), template));
