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
    const document = content === null ? null : openDocument(file, content);
    if (found !== null) mapping = found;
    else if (document !== null) documents.push(document);
    else tables.push(file);
  }
  const [document] = documents;
  if (document !== undefined && files.length > 1) return fault(tables.length > 0 ? "mixed" : "several");
  if (document !== undefined) return document;
  const known = tables.length > 0 ? tables : before?.kind === "tables" ? [...before.files] : [];
  if (known.length > 0) return { kind: "tables", files: known, mapping };
  return mapping === null ? fault("empty") : { kind: "mapping", name, mapping };
}

/** What JSON is; null if it is none of our documents: the service finds tables in it, or says where it is wrong. */
function openDocument(file: File, content: string): Opened | null {
  const campaign = understand(content);
  if (campaign === "sweeps" || campaign === "empty") return { kind: "fault", name: file.name, fault: campaign };
  if (campaign === "not_finite") return { kind: "fault", name: `${file.name}: ${notFinite(content)}`, fault: campaign };
  return typeof campaign === "string" ? null : { kind: "campaign", name: file.name, campaign };
}

const isJson = async (file: File): Promise<boolean> =>
  /\.json$/i.test(file.name) || /^\ufeff?\s*[{[]/.test(await file.slice(0, 200).text());
