/** Several runs beside each other: verdict, what they explain, and each joint. */
import { api } from "../api/client";
import type { Run } from "../api/types";
import { ActionButton, Empty, Head, Show } from "../components/basics";
import { percent } from "../lib/format";
import { useAction } from "../state/action";
import { compareSides } from "../state/comparing";
import { useLoad } from "../state/load";
import { link } from "../state/router";
import { storedSet } from "../state/names";
import { text } from "../i18n";
import { later } from "../i18n/later";
import { StiffnessFigure } from "./joint_table";
import { MOST_RUNS } from "./runs";
import { type RunColumn, RunsTable } from "./runs_table";

const words = text.lists;
export function SideBySideView({ ids }: { ids: string[] }) {
  const loaded = useLoad(
    async (signal) => {
      const runs = await Promise.all(ids.slice(0, MOST_RUNS).map((id) => api.runs.one(id, signal)));
      const sets = await Promise.all(runs.map((run) => storedSet(run.request.measurement_set_id)));
      return runs.map((run, i): RunColumn => ({ run, name: sets[i]?.name ?? run.id, note: how(run) }));
    },
    [ids.join()],
  );
  return (
    <Show of={loaded} title={words.compare}>
      {(columns) =>
        columns.length < 2 ? <Empty title={words.compare} hint={words.selectTwo} /> : <Page columns={columns} />
      }
    </Show>
  );
}

const how = ({ request }: Run): string =>
  [
    text.methods[request.method],
    request.positive ? text.options.constrained : text.options.unconstrained,
    ...(request.loss === "huber" ? [text.assessment.changed.loss.huber] : []),
    ...(request.leave_out.length > 0 ? [words.without(request.leave_out)] : []),
  ].join(", ");

function Page({ columns }: { columns: RunColumn[] }) {
  const [first, second] = columns;
  const pair = useAction(async () => {
    if (!first || !second) return;
    const made = await compareSides([{ run: first.run }, { run: second.run }], false, false);
    return link(["compare", "methods", made.id]);
  });
  const title = columns.map((column) => column.name).join(" · ");
  return (
    <>
      <Head
        kind={later.compare.title}
        plain={title}
        title={words.sideBySide(columns.length)}
        first={columns.length === 2 && <ActionButton action={pair}>{words.test}</ActionButton>}
      />
      <section class="card">
        <RunsTable columns={columns} label={title} />
      </section>
      <StiffnessFigure
        title={text.run.stiffness}
        level={percent(first?.run.request.confidence ?? 0.95)}
        series={columns.map(({ run, name }, i) => ({
          label: `${name}: ${how(run)}`,
          mark: `method-${i}`,
          joints: run.result?.joints ?? [],
        }))}
      />
    </>
  );
}
