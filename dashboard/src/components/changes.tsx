/** Rename, archive or delete a robot or a measurement set: nothing is computed from either. */
import { useAction, useDeletion } from "../state/action";
import { namesChanged } from "../state/names";
import { toast } from "../state/toasts";
import { text } from "../i18n";
import { Button, ProblemNote } from "./basics";

interface Change {
  name?: string;
  archived?: boolean;
}

interface Stored {
  change: (id: string, change: Change) => Promise<unknown>;
  delete: (id: string) => Promise<unknown>;
  restore: (id: string) => Promise<unknown>;
}

interface StoredProps {
  of: { id: string; name: string; archived: boolean };
  api: Stored;
  /** Address of the list that it stands in. */
  list: string;
  changed: () => void;
}

/** What can be done with any robot and any set. Deletion is asked first; while others refer to it the service refuses. */
export function StoredActions({ of: { id, name, archived }, api, list, changed }: StoredProps) {
  const words = text.changes;
  const action = useAction(async (asked: Change) => {
    await api.change(id, asked);
    namesChanged();
    if (asked.archived !== undefined) toast(asked.archived ? words.archivedNow(name) : words.back(name));
    changed();
  });
  const deletion = useDeletion({
    remove: () => api.delete(id).then(namesChanged),
    restore: () => api.restore(id).then(namesChanged),
    list,
    deleted: text.deletion.done(name),
  });
  const rename = () => {
    const typed = prompt(words.newName, name)?.trim();
    if (typed && typed !== name) action.run({ name: typed });
  };
  const remove = () => confirm(text.deletion.sure(name)) && deletion.run();
  const problem = action.problem ?? deletion.problem;
  return (
    <>
      <Button acts look="quiet" disabled={action.busy} onClick={rename}>
        {words.rename}
      </Button>
      <Button acts look="quiet" disabled={action.busy} onClick={() => action.run({ archived: !archived })}>
        {archived ? words.unarchive : words.archive}
      </Button>
      <Button acts look="quiet" disabled={deletion.busy} onClick={remove}>
        {text.run.delete}
      </Button>
      {problem && <ProblemNote problem={problem} />}
    </>
  );
}
