/** The first step of a flow: where files are dropped, and why one was refused. */
import { DropZone } from "../components/drop";
import type { Opened } from "../state/opened";
import { text } from "../i18n";

const ACCEPTED = ".json,.csv,.tsv,.txt,.asc,.xyz,.dat,.xlsx,application/json,text/csv,text/plain";

export function FileDrop({ again, take }: { again: boolean; take: (...files: File[]) => void }) {
  return (
    <DropZone
      title={text.files.drop}
      hint={text.files.dropHint}
      accept={ACCEPTED}
      several
      compact={again}
      button={again ? text.files.another : text.files.choose}
      take={take}
    />
  );
}

export function Refused({ opened }: { opened: Opened & { kind: "fault" } }) {
  const [title, remedy] = text.files.faults[opened.fault];
  return (
    <div class="note bad" role="alert">
      <h3>{title}</h3>
      <p>
        <bdi>{opened.name}</bdi>
      </p>
      <p>
        <b>{text.errors.remedy}:</b> {remedy}
      </p>
    </div>
  );
}
