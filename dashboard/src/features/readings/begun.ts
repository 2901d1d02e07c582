/** Files that are not identified yet, with what was stated of them: one may add a robot meanwhile, or come back. */
import type { ImportOptions } from "../../api/types";
import { type Typed, typedOf } from "../../lib/campaign";
import { type Template, templatesIn, withTemplate } from "./imports";
import type { Fields } from "../../lib/json";
import { keep, kept, recalled, remember } from "../../state/kept";
import type { Opened } from "./opening";
import { client, type QueryOptions } from "../../state/query";

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

interface Begun {
  opened: Opened;
  draft: Draft | null;
}

/** Where they are kept; what an older page kept as `tables` had other fields. */
const NAME = "files";

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

export const keepFiles = (opened: Opened | null): void =>
  putBegun(opened?.kind === "tables" ? { opened, draft: null } : null);

export const keptTemplates = (): Template[] => templatesIn(recalled("templates"));
export const keepTemplate = (template: Template): void =>
  remember("templates", withTemplate(keptTemplates(), template));
