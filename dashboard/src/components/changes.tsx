/** Rename or archive a robot or a measurement set: nothing is computed from either. */
import { useAction } from "../state/action";
import { namesChanged } from "../state/names";
import { storedChanged } from "../state/stored";
import { toast } from "../state/toasts";
import { text } from "../i18n";
import { Button, ProblemNote } from "./basics";

export interface Change {
  name?: string;
  archived?: boolean;
}

export function Changes({
  name,
  archived,
  change,
  changed,
}: {
  name: string;
  archived: boolean;
  change: (change: Change) => Promise<unknown>;
  changed: () => void;
}) {
  const words = text.changes;
  const action = useAction(async (asked: Change) => {
    await change(asked);
    storedChanged();
    namesChanged();
    if (asked.archived !== undefined) toast(asked.archived ? words.archivedNow(name) : words.back(name));
    changed();
  });
  const rename = () => {
    const typed = prompt(words.newName, name)?.trim();
    if (typed && typed !== name) action.run({ name: typed });
  };
  return (
    <>
      <Button look="quiet" disabled={action.busy} onClick={rename}>
        {words.rename}
      </Button>
      <Button look="quiet" disabled={action.busy} onClick={() => action.run({ archived: !archived })}>
        {archived ? words.unarchive : words.archive}
      </Button>
      {action.problem && <ProblemNote problem={action.problem} />}
    </>
  );
}
