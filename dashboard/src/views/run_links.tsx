/** Where more than joints may bend: what each joint and link explains, and which model the readings call for. */
import type { RunResult } from "../api/types";
import { Shares } from "../charts/bars";
import { Figure } from "../charts/figure";
import { DataTable } from "../parts/table";
import { percent } from "../pure/format";
import { text } from "../text";

const words = text.links;
type Links = NonNullable<RunResult["links"]>;
type Selection = NonNullable<RunResult["selection"]>;

export function ElementShares({ links }: { links: Links }) {
  const named = links.elements.map(({ kind, joint, share }) => ({
    name: joint === null ? (words.kinds[kind] ?? kind) : kind === "link" ? words.link(joint) : joint,
    share,
    note: "",
  }));
  const rows = [...named, { name: words.unexplained, share: links.unexplained, note: "" }];
  return (
    <Figure
      title={words.elements}
      note={words.elementsNote}
      table={{
        columns: [{ title: words.element }, { title: text.run.contributionShare, show: percent }],
        rows: rows.map(({ name, share }) => [name, share]),
      }}
    >
      {(width) => <Shares shares={rows} width={width} label={words.elements} />}
    </Figure>
  );
}

export function ModelChoice({ selection }: { selection: Selection }) {
  const name = (model: string) => text.elasticities[model] ?? model;
  return (
    <section class="card">
      <h2>{words.selection}</h2>
      <p>{words.selected(name(selection.simplest), name(selection.best))}</p>
      <DataTable
        caption={words.selection}
        table={{
          columns: [
            { title: words.model },
            { title: words.heldOut, show: percent },
            { title: words.deviation, show: percent },
          ],
          rows: selection.models.map(({ model, compensation, standard_error }) => [
            name(model),
            compensation,
            standard_error,
          ]),
        }}
      />
    </section>
  );
}
