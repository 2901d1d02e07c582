/** What can be done with any job that is shown: its link, its file, its end. */
import type { ComponentChildren } from "preact";
import { fileName } from "../lib/csv";
import { useDeletion } from "../state/deletion";
import { toast } from "../state/toasts";
import { text } from "../i18n";
import { ProblemNote } from "./basics";
import { save } from "./download";

/** Kinds whose report is for information; that of a run, which is signed, stands among its files. */
const REPORTED: Record<string, string> = {
  comparison: "comparisons",
  pair: "pairs",
  plan: "plans",
  map: "maps",
  program: "programs",
};

export function JobActions({
  kind,
  job,
  name,
  remove,
  restore,
  list,
  children,
}: {
  /** Of the file that is downloaded. */
  kind: string;
  job: { id: string; result?: unknown };
  name: string;
  /** Null while it goes on. */
  remove: (() => Promise<unknown>) | null;
  restore: () => Promise<unknown>;
  /** Address of the list that it stands in. */
  list: string;
  children?: ComponentChildren;
}) {
  const share = () => {
    if (!navigator.clipboard) return void prompt(text.run.share, location.href); // plain http has no clipboard
    void navigator.clipboard.writeText(location.href).then(() => toast(text.run.shared));
  };
  const deletion = useDeletion({
    remove: async () => remove?.(),
    restore,
    list,
    deleted: text.runs.deleted(name),
  });
  return (
    <>
      <div class="actions">
        {children}
        <button type="button" class="button" onClick={share}>
          {text.run.share}
        </button>
        <button
          type="button"
          class="button"
          title={text.run.downloadHint}
          onClick={() => save(JSON.stringify(job, null, 2), "application/json", fileName(`${kind}-${job.id}`, "json"))}
        >
          {text.run.download}
        </button>
        {kind in REPORTED && job.result && (
          <a class="button" href={`/v1/${REPORTED[kind]}/${job.id}/report.pdf`} download>
            {text.run.report}
          </a>
        )}
        {remove && (
          <button type="button" class="button quiet" disabled={deletion.busy} onClick={deletion.run}>
            {text.run.delete}
          </button>
        )}
      </div>
      {deletion.problem && <ProblemNote problem={deletion.problem} />}
    </>
  );
}
