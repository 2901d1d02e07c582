/** One measurement set: what it says, its findings, what was made of it. */
import type { MeasurementSet } from "../api/types";
import { api } from "../api/client";
import { LinkButton, Name, Show, Title, Warnings, When } from "../components/basics";
import { Changes } from "../components/changes";
import { DeleteButton } from "../components/delete_button";
import { Preview } from "../components/preview";
import { factsOf } from "../lib/campaign";
import { useLoad, valueOf } from "../state/load";
import { useNames } from "../state/names";
import { storedSet } from "../state/stored";
import { link } from "../state/router";
import { text } from "../i18n";
import { useRunsOf } from "./robots";
import { RunList } from "./runs";
import { SetMetadata } from "./set_metadata";

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
      <div class="head">
        <Title kind={text.sets.kind} plain={set.name}>
          <Name>{set.name}</Name>
        </Title>
        <p class="meta">
          <a href={link(["robots", set.robot_id])}>
            <Name>{names?.robot(set.robot_id) ?? "…"}</Name>
          </a>
          <When time={set.measured_at ?? set.created_at} />
          {set.archived && <span>{text.changes.archived}</span>}
        </p>
        <div class="actions">
          <LinkButton look="primary" href={link([], { set: set.id })}>
            {text.sets.identify}
          </LinkButton>
          <LinkButton href={link(["compare", "methods"], { set: set.id })}>{text.sets.compare}</LinkButton>
          <LinkButton href={link(["plans"], { set: set.id })}>{text.plan.goOn}</LinkButton>
          <Changes
            name={set.name}
            archived={set.archived}
            change={(change) => api.sets.change(set.id, change)}
            changed={changed}
          />
          <DeleteButton
            name={set.name}
            list="#/sets"
            remove={() => api.sets.delete(set.id)}
            restore={() => api.sets.restore(set.id)}
          />
        </div>
      </div>
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
