/** What people noted about a set, and the form to change it: the readings stay as they are. */
import { useState } from "preact/hooks";
import { METADATA, type MeasurementSet } from "../api/types";
import { api } from "../api/client";
import { Button, Facts, ProblemNote, When } from "../components/basics";
import { MetadataForm } from "../components/metadata_form";
import { notedIn, typedOf } from "../lib/metadata";
import { useAction } from "../state/action";
import { namesChanged } from "../state/names";
import { storedChanged } from "../state/stored";
import { text } from "../i18n";

export function SetMetadata({ set, changed }: { set: MeasurementSet; changed: () => void }) {
  const words = text.metadata;
  const [typed, setTyped] = useState(() => typedOf(set));
  const [editing, setEditing] = useState(false);
  const save = useAction(async () => {
    const noted = notedIn(typed);
    if (noted === null) return;
    await api.sets.change(set.id, noted);
    storedChanged();
    namesChanged();
    setEditing(false);
    changed();
  });
  const known = METADATA.filter((name) => set[name]);
  return (
    <section class="card">
      <h2>{words.title}</h2>
      {editing ? (
        <form
          class="noting"
          onSubmit={(event) => {
            event.preventDefault();
            save.run();
          }}
        >
          <MetadataForm typed={typed} change={setTyped} />
          {save.problem && <ProblemNote problem={save.problem} />}
          <div class="actions">
            <button type="submit" class="button primary" disabled={save.busy || notedIn(typed) === null}>
              {words.save}
            </button>
            <Button onClick={() => setEditing(false)}>{words.cancel}</Button>
          </div>
        </form>
      ) : (
        <>
          {known.length === 0 ? (
            <p class="soft">{words.none}</p>
          ) : (
            <Facts
              facts={known.map((name) => ({
                label: words.fields[name],
                value: name === "measured_at" ? <When time={set[name] ?? ""} /> : <Noted>{set[name] ?? ""}</Noted>,
              }))}
            />
          )}
          <Button
            onClick={() => {
              setTyped(typedOf(set));
              setEditing(true);
            }}
          >
            {known.length === 0 ? words.add : words.edit}
          </Button>
        </>
      )}
    </section>
  );
}

/** A text that someone else chose, in its lines. */
const Noted = ({ children }: { children: string }) => <bdi class="name noted">{children}</bdi>;
