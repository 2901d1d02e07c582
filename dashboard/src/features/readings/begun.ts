/** Files that are not identified yet, with what was stated of them: one may add a robot meanwhile, or come back. */
import type { Mapping } from "../../api/types";
import { type Typed, typedOf } from "../../lib/campaign";
import { keep, kept } from "../../state/kept";
import type { Opened } from "./opening";
import { client, type QueryOptions } from "../../state/query";

/** What was stated of tables so far. */
interface Draft {
  mapping: Mapping;
  /** Id of the chosen robot; null until one is chosen. */
  robot: string | null;
  /** What is noted about the measurement. */
  typed: Typed;
}

/** Nothing stated yet but what a mapping says. */
export const freshDraft = (mapping: Mapping, robot: string | null): Draft => ({ mapping, robot, typed: typedOf({}) });

interface Begun {
  opened: Opened;
  draft: Draft | null;
}

/** Where they are kept; what an older page kept as `files` had other fields. */
const NAME = "import";

/** Files that were opened before, also before the page was loaded again. */
export const begunFiles: QueryOptions<Begun | null> = {
  queryKey: ["device", NAME],
  queryFn: () => kept<Begun>(NAME),
  staleTime: "static",
  gcTime: Number.POSITIVE_INFINITY,
  structuralSharing: false, // files are compared by identity
};

const begun = (): Begun | null => client.getQueryData<Begun | null>(begunFiles.queryKey) ?? null;

function putBegun(next: Begun | null): void {
  client.setQueryData(begunFiles.queryKey, next);
  void keep(NAME, next);
}

export function keptDraft(files: File[]): Draft | null {
  const before = begun();
  return before?.opened.kind === "tables" && before.opened.files === files ? before.draft : null;
}

export function keepDraft(draft: Draft): void {
  const before = begun();
  if (before) putBegun({ ...before, draft });
}

/** Keep tables. Files that are opened again, corrected meanwhile, have what was stated of them before. */
export function keepFiles(opened: Opened | null): void {
  const before = begun();
  const isAgain = opened !== null && before !== null && namesOf(before.opened) === namesOf(opened);
  const tables = opened?.kind === "tables" ? opened : null;
  const draft = isAgain && tables?.mapping === null ? before.draft : null;
  putBegun(tables && { opened: tables, draft });
}

const namesOf = (opened: Opened): string =>
  opened.kind === "tables" ? opened.files.map(({ name }) => name).join("/") : "";

const HANDED = ["device", "handed"];

/** Hand a file to another view, which takes it once. */
export const handFile = (file: File): void => void client.setQueryData(HANDED, file);

export function takeHanded(): File | null {
  const file = client.getQueryData<File>(HANDED) ?? null;
  client.removeQueries({ queryKey: HANDED });
  return file;
}
