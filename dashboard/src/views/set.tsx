/** One measurement set: what it says, its findings, what was made of it. */
import { useState } from "preact/hooks";
import { METADATA, type MeasurementSet } from "../api/types";
import { api } from "../api/client";
import { NameLink, Button, Facts, Form, Head, LinkButton, Name, Show, Warnings, When } from "../components/basics";
import { MetadataForm } from "../components/schema_form";
import { notedIn, typedOf, factsOf } from "../lib/campaign";
import { useAction, link } from "../state/action";
import { namesChanged, useNames, storedSet, useLoad, valueOf } from "../state/load";
import { text } from "../i18n";
import { later } from "../i18n/later";
import { StoredActions } from "../components/list";
import { Preview } from "../components/findings";
import { useRunsOf } from "./robots";
import { RunList } from "./runs";

export function SetView({ id }: { id: string }) {
  const loaded = useLoad(() => storedSet(id), [id]);
  return (
    <Show of={loaded} title={text.sets.kind}>
      {(set) => <SetPage set={set} changed={loaded.reload} />}
    </Show>
  );
}

function SetPage({ set, changed }: { set: MeasurementSet; changed: () => void }) {
  const names = valueOf(useNames());
  const runs = valueOf(useRunsOf({ measurement_set_id: set.id }));
  return (
    <>
      <Head
        kind={text.sets.kind}
        plain={set.name}
        title={<Name>{set.name}</Name>}
        about={
          <>
            <NameLink to={["robots", set.robot_id]}>{names?.robot(set.robot_id) ?? "…"}</NameLink>
            <span>{text.sets.observations(set.observations.length)}</span>
            <When time={set.measured_at ?? set.created_at} />
            {set.archived && <span>{text.changes.archived}</span>}
          </>
        }
        first={
          <LinkButton look="primary" href={link([], { set: set.id })}>
            {text.sets.identify}
          </LinkButton>
        }
      >
        <LinkButton href={link(["compare", "methods"], { set: set.id })}>{text.sets.compare}</LinkButton>
        <LinkButton href={link(["plans"], { set: set.id })}>{later.plan.goOn}</LinkButton>
        <StoredActions of={set} api={api.sets} list="#/sets" changed={changed} />
      </Head>
      <div class="flow">
        <section class="card">
          <h2>{text.files.understood}</h2>
          <Preview facts={factsOf(set as never)} />
        </section>
        <SetMetadata set={set} changed={changed} />
        <section class="card">
          <h2>{text.sets.findings}</h2>
          {set.warnings.length > 0 ? <Warnings warnings={set.warnings} /> : <p class="note good">{text.files.clean}</p>}
        </section>
      </div>
      {runs && runs.length > 0 && (
        <section>
          <h2>{text.sets.runs}</h2>
          <RunList runs={runs} names={names} />
        </section>
      )}
    </>
  );
}

/** What people noted about a set, and the form to change it: the readings stay as they are. */
export function SetMetadata({ set, changed }: { set: MeasurementSet; changed: () => void }) {
  const words = later.metadata;
  const [typed, setTyped] = useState(() => typedOf(set));
  const [editing, setEditing] = useState(false);
  const save = useAction(async () => {
    const noted = notedIn(typed);
    if (noted === null) return;
    await api.sets.change(set.id, noted);
    namesChanged();
    setEditing(false);
    changed();
  });
  const known = METADATA.filter((name) => set[name]);
  return (
    <section class="card">
      <h2>{words.title}</h2>
      {editing ? (
        <Form action={save} class="noting">
          <MetadataForm typed={typed} change={setTyped} />
          <div class="actions">
            <Button acts type="submit" look="primary" disabled={save.busy || notedIn(typed) === null}>
              {words.save}
            </Button>
            <Button onClick={() => setEditing(false)}>{words.cancel}</Button>
          </div>
        </Form>
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
            acts
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
