/** Delete a robot or a measurement set: asked first; while others refer to it the service refuses. */
import { namesChanged } from "../state/names";
import { useDeletion } from "../state/deletion";
import { storedChanged } from "../state/stored";
import { text } from "../i18n";
import { Button, ProblemNote } from "./basics";

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
    storedChanged();
    namesChanged();
  };
  const deletion = useDeletion({
    remove: () => changed(remove),
    restore: () => changed(restore),
    list,
    deleted: text.deletion.done(name),
  });
  return (
    <>
      <Button look="quiet" disabled={deletion.busy} onClick={() => confirm(text.deletion.sure(name)) && deletion.run()}>
        {text.run.delete}
      </Button>
      {deletion.problem && <ProblemNote problem={deletion.problem} />}
    </>
  );
}
