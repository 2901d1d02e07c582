/** The first step of a flow: where files are dropped, and why one was refused. */
import type { ComponentChildren } from "preact";
import { Button, ProblemNote } from "../components/basics";
import { elsewhere } from "../lib/faults";
import type { Action } from "../state/action";
import { text } from "../i18n";
import { SETTINGS_FIELDS } from "./advanced";
import { DropZone } from "../components/drop";

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

/** A step of a flow, with its number. */
export const Step = ({ at, title, wide = false, children }: StepProps) => (
  <section class={wide ? "card wide" : "card"} aria-labelledby={`step-${at}`}>
    <h2 id={`step-${at}`}>
      <span class="step">{at}</span>
      {title}
    </h2>
    {children}
  </section>
);

interface StepProps {
  at: number;
  title: string;
  wide?: boolean;
  children: ComponentChildren;
}

/** A file that is none of ours: what is wrong, and what to do. */
export function Refused({ file, why: [title, remedy] }: { file: string; why: readonly string[] }) {
  return (
    <div class="note bad" role="alert">
      <h3>{title}</h3>
      <p>
        <bdi>{file}</bdi>
      </p>
      <p>
        <b>{text.errors.remedy}:</b> {remedy}
      </p>
    </div>
  );
}

/** The one button at the end of a flow, and why it cannot be pressed yet. */
export function GoBar({ action, ready, why }: { action: Action<[]>; ready: boolean; why: string | null }) {
  return (
    <div class={ready ? "gobar wide ready" : "gobar wide"}>
      {action.problem && <ProblemNote problem={elsewhere(action.problem, SETTINGS_FIELDS)} />}
      <div class="go">
        <Button acts look="primary big" disabled={!ready || action.busy} onClick={action.run}>
          {action.busy ? text.start.going : text.start.go}
        </Button>
        {!ready && why !== null && <span class="soft">{why}</span>}
      </div>
    </div>
  );
}
