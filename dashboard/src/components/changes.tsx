/** Rename or archive a robot or a measurement set: nothing is computed from either. */
import { useContext } from "preact/hooks";
import { Viewer } from "../state/session";
import { useAction } from "../state/action";
import { useDeletion } from "../state/deletion";
import { namesChanged } from "../state/names";
import { toast } from "../state/toasts";
import { text } from "../i18n";
import { Button, forbidden, ProblemNote } from "./basics";

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
  const viewer = forbidden(useContext(Viewer));
  const action = useAction(async (asked: Change) => {
    await change(asked);
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
      <Button look="quiet" disabled={action.busy} onClick={rename} {...viewer}>
        {words.rename}
      </Button>
      <Button look="quiet" disabled={action.busy} onClick={() => action.run({ archived: !archived })} {...viewer}>
        {archived ? words.unarchive : words.archive}
      </Button>
      {action.problem && <ProblemNote problem={action.problem} />}
    </>
  );
}

/** Delete a robot or a measurement set: asked first; while others refer to it the service refuses. */
export function DeleteButton({
  name,
  list,
  remove,
  restore,
}: {
  name: string;
  list: string;
  remove: () => Promise<unknown>;
  restore: () => Promise<unknown>;
}) {
  const changed = async (change: () => Promise<unknown>) => {
    await change();
    namesChanged();
  };
  const viewer = forbidden(useContext(Viewer));
  const deletion = useDeletion({
    remove: () => changed(remove),
    restore: () => changed(restore),
    list,
    deleted: text.deletion.done(name),
  });
  return (
    <>
      <Button
        look="quiet"
        disabled={deletion.busy}
        onClick={() => confirm(text.deletion.sure(name)) && deletion.run()}
        {...viewer}
      >
        {text.run.delete}
      </Button>
      {deletion.problem && <ProblemNote problem={deletion.problem} />}
    </>
  );
}

interface Stored {
  change: (id: string, change: Change) => Promise<unknown>;
  delete: (id: string) => Promise<unknown>;
  restore: (id: string) => Promise<unknown>;
}

/** What can be done with any robot and any set. */
export const StoredActions = ({
  of: { id, name, archived },
  api,
  list,
  changed,
}: {
  of: { id: string; name: string; archived: boolean };
  api: Stored;
  list: string;
  changed: () => void;
}) => (
  <>
    <Changes name={name} archived={archived} change={(change) => api.change(id, change)} changed={changed} />
    <DeleteButton name={name} list={list} remove={() => api.delete(id)} restore={() => api.restore(id)} />
  </>
);
