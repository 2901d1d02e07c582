/** The verdict on a run, on top of it: one sentence, its reasons, and a button for each thing that can be done. */
import { api } from "../api/client";
import type { Action, Assessment, Finding, Run, Usability } from "../api/types";
import { Badge, ActionButton, LinkButton, Prose, Seen } from "../components/basics";
import { sentence } from "../lib/said";
import { useAction } from "../state/action";
import { namesChanged } from "../state/names";
import { link } from "../state/router";
import { text } from "../i18n";
import type { RunContext } from "./run_context";

const words = text.assessment;

export function VerdictCard({
  assessment,
  context,
  sentences = words.sentence,
}: {
  assessment: Assessment;
  context: RunContext | null;
  /** What each verdict means, where it is not about stiffnesses. */
  sentences?: Record<Usability, string>;
}) {
  const { verdict, reasons, notes, joints_identified: identified, joint_count: count } = assessment;
  const counted = identified != null && count != null;
  return (
    <section class={`verdict-card ${verdict}`} aria-label={words.title}>
      <h2>
        <Badge verdict={verdict} large />
        <span>
          {assessment.headline ??
            (counted && verdict === "use" ? words.supported(identified, count) : sentences[verdict])}
          {counted && verdict !== "use" && <b> {words.identified(identified, count)}</b>}
        </span>
      </h2>
      {reasons.length > 0 && (
        <ul>
          {grouped(reasons).map((group) => (
            <ReasonItem reasons={group} context={context} />
          ))}
        </ul>
      )}
      {notes.map((note) => (
        <p class="note">
          <Prose text={note} />
        </p>
      ))}
    </section>
  );
}

/** Reasons of one kind stand together. */
function grouped(reasons: Finding[]): Finding[][] {
  const groups = new Map<string, Finding[]>();
  for (const reason of reasons) {
    const key = `${reason.code}\n${reason.remedy}`;
    groups.set(key, [...(groups.get(key) ?? []), reason]);
  }
  return [...groups.values()];
}

function ReasonItem({ reasons, context }: { reasons: Finding[]; context: RunContext | null }) {
  const [first] = reasons;
  if (!first) return null;
  const actions = unique(reasons.flatMap(({ action }) => (action ? [action] : [])));
  return (
    <li class={first.weight}>
      <div>
        {reasons.map((reason) => (
          <Seen warning={reason} />
        ))}
        <p class="remedy">
          <Prose text={sentence(first.remedy)} />
        </p>
      </div>
      {context && actions.length > 0 && (
        <div class="actions">
          {actions.map((action) => (
            <ActionButtons action={action} context={context} />
          ))}
        </div>
      )}
    </li>
  );
}

function unique(actions: Action[]): Action[] {
  return [...new Map(actions.map((action) => [JSON.stringify(action), action])).values()];
}

/** What the action does, and where it is about postures, one to look at it first. */
function ActionButtons({ action, context }: { action: Action; context: RunContext }) {
  const start = useAction(async () => {
    const run = await variantBy(context.run, action);
    return link(["runs", run.id]);
  });
  const [shown] = action.observations;
  return (
    <>
      {action.kind !== "show_posture" && (
        <ActionButton action={start} going={words.doing}>
          {words.actions[action.kind](action)}
        </ActionButton>
      )}
      {shown !== undefined && (
        <LinkButton look="quiet" href={link(["runs", context.run.id, "robot"], { at: shown, from: "result" })}>
          {words.show(shown)}
        </LinkButton>
      )}
    </>
  );
}

/** Carry out an action; pressed twice it gives the same run. */
export async function variantBy(run: Run, action: Action): Promise<Run> {
  const made = await api.apply(run.id, action);
  namesChanged();
  return made;
}
