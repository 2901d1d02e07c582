/** Where more than joints may bend: what each joint and link explains, and which model the readings call for. */
import type { Elasticity, RunResult } from "../api/types";
import { Shares } from "../charts/bars";
import { Figure } from "../charts/figure";
import { DataTable } from "../components/table";
import { percent, significant } from "../lib/format";
import { text } from "../i18n";

const words = text.links;
type Links = NonNullable<RunResult["links"]>;
type Selection = NonNullable<RunResult["selection"]>;

export function ElementShares({ links }: { links: Links }) {
  const named = links.elements.map(({ kind, joint, share }) => ({
    name: joint === null ? words.kinds[kind] : kind === "link" ? words.link(joint) : joint,
    share,
    note: "",
  }));
  const rows = [...named, { name: words.unexplained, share: links.unexplained, note: "" }];
  return (
    <Figure
      title={words.elements}
      note={`${words.elementsNote} ${words.chosenBy(
        words.sources[links.model_source],
        `${text.losses[links.loss]} ${words.sources[links.loss_source]}`,
        `${significant(links.penalty, 2)} ${words.sources[links.penalty_source]}`,
      )}`}
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
  const name = (model: Elasticity) => text.elasticities[model];
  return (
    <section class="card">
      <h2>{words.selection}</h2>
      <p>
        {words.thisRun(name(selection.chosen), text.losses[selection.chosen_loss])}{" "}
        {words.selected(name(selection.simplest), name(selection.best))}
      </p>
      <DataTable
        caption={words.selection}
        table={{
          columns: [
            { title: words.model },
            { title: words.loss },
            { title: words.heldOut, show: percent },
            { title: words.deviation, show: percent },
            { title: words.penalty, show: (value) => significant(value, 2) },
          ],
          rows: selection.models.map(({ model, loss, compensation, standard_error, penalty }) => [
            name(model),
            text.losses[loss],
            compensation,
            standard_error,
            penalty,
          ]),
        }}
      />
    </section>
  );
}
