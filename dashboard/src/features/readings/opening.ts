/** Files that were dropped or chosen, and what they are: a campaign, tables of readings, or a mapping for tables. */
import type { Mapping } from "../../api/types";
import type { FileFault } from "../../words";
import { type Campaign, notFinite, understand } from "../../lib/campaign";
import { mappingIn } from "./mapping";

const MAX_BYTES = 8 * 1024 * 1024;

export type Opened =
  | { kind: "campaign"; name: string; campaign: Campaign }
  | { kind: "tables"; files: File[]; mapping: Mapping | null }
  | { kind: "mapping"; name: string; mapping: Mapping }
  | { kind: "sweeps"; file: File }
  | { kind: "fault"; name: string; fault: FileFault };

/** Look at files. A mapping goes with the tables it comes with, or with those `before` or after it. */
export async function open(files: File[], before: Opened | null): Promise<Opened> {
  const name = files.map((file) => file.name).join(", ");
  const fault = (fault: FileFault): Opened => ({ kind: "fault", name, fault });
  if (files.reduce((sum, file) => sum + file.size, 0) > MAX_BYTES) return fault("too_large");
  const tables: File[] = [];
  const documents: Opened[] = [];
  let mapping: Mapping | null = before?.kind === "mapping" ? before.mapping : null;
  for (const file of files) {
    const content = (await isJson(file)) ? await file.text() : null;
    const found = content === null ? null : mappingIn(content);
    if (found !== null) mapping = found;
    else if (content === null || isTable(content)) tables.push(file);
    else documents.push(openDocument(file, content));
  }
  const [document] = documents;
  if (document !== undefined && files.length > 1) return fault(tables.length > 0 ? "mixed" : "several");
  if (document !== undefined) return document;
  const known = tables.length > 0 ? tables : before?.kind === "tables" ? [...before.files] : [];
  if (known.length > 0) return { kind: "tables", files: known, mapping };
  return mapping === null ? fault("empty") : { kind: "mapping", name, mapping };
}

/** Whether JSON is none of our documents: the service looks for tables in it, or says where the JSON is wrong. */
const isTable = (content: string): boolean =>
  ["not_object", "not_a_set", "not_json"].includes(understand(content) as string);

function openDocument(file: File, content: string): Opened {
  const campaign = understand(content);
  if (campaign === "sweeps") return { kind: "sweeps", file };
  if (typeof campaign !== "string") return { kind: "campaign", name: file.name, campaign };
  const place = campaign === "not_finite" ? `: ${notFinite(content)}` : "";
  return { kind: "fault", name: `${file.name}${place}`, fault: campaign };
}

const isJson = async (file: File): Promise<boolean> =>
  /\.json$/i.test(file.name) || /^\ufeff?\s*[{[]/.test(await file.slice(0, 200).text());
