/** Files that were dropped or chosen, and what they are: a campaign, tables of readings, or a template for them. */
import { api } from "../../api/calls";
import { problemOf } from "../../api/problem";
import type { FileFault } from "../../words";
import { type Campaign, notFinite, understand } from "../../lib/campaign";
import { type Template, templateIn } from "./imports";

const MAX_BYTES = 8 * 1024 * 1024;

export type Opened =
  | { kind: "campaign"; name: string; campaign: Campaign }
  | { kind: "tables"; files: File[]; template: Template | null }
  | { kind: "template"; template: Template }
  | { kind: "fault"; name: string; fault: FileFault };

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
