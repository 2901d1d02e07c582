/** Words of archive and restore. */
import { plural } from "../../words/shared";

export const archiveWords = {
  forbidden:
    "Archives need a key with the role admin, or a service that only its own machine reaches. At the terminal: `jointstiff archive` and `jointstiff restore`.",
  save: "Archive",
  saveHint:
    "One file with all robots, measurement sets, runs and other work, and the audit, without keys. The service goes on meanwhile.",
  download: "Download the archive",
  restore: "Restore",
  restoreHint:
    "Choose an archive. Before a restore, the page shows what the restore would add. Records that are there already stay as they are.",
  choose: "Choose an archive",
  choosing: "Choose another archive",
  reading: "Reading the archive…",
  restoring: "Restoring…",
  ofArchive: (name: string, layout: string) => `${name}, layout ${layout}`,
  records: "Records",
  inArchive: "In the archive",
  toAdd: "To add",
  added: "Added",
  present: "There already",
  refused: "Cannot be restored",
  tables: {
    robots: "Robots",
    measurement_sets: "Measurement sets",
    open_sets: "Live campaigns",
    live_entries: "Readings of live campaigns",
    jobs: "Runs and other work",
    idempotency_keys: "Idempotency keys",
    access_keys: "keys",
    audit: "audit",
  } as Record<string, string>,
  begin: (count: number) => `Restore ${plural(count, "record", "records")}`,
  nothing: "The service has all records of this archive already.",
  finished: (count: number) => `${plural(count, "record was", "records were")} added.`,
  leftOut: (name: string, count: number) => `Not restored on the page: ${name} (${count}). Use \`jointstiff restore\`.`,
  dropped: (name: string, count: number) =>
    `This version has no place for the field ${name} of ${plural(count, "document", "documents")}: it remains in the archive.`,
  again: "What was added is kept: restore the same archive again to go on.",
};
