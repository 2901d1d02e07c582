/** Several runs beside each other: verdict, what they explain, and each joint. */
import { api } from "../api/client";
import type { Run } from "../api/types";
import { Figure } from "../charts/figure";
import { StiffnessIntervals, markOf } from "../charts/intervals";
import { ActionButton, Empty, Show, Title } from "../components/basics";
import { percent } from "../lib/format";
import { useAction } from "../state/action";
import { compareSides } from "../state/comparing";
import { useLoad } from "../state/load";
import { go, link } from "../state/router";
import { useSettings } from "../state/settings";
import { storedSet } from "../state/stored";
import { text } from "../i18n";
import { stiffnessTable } from "./joint_table";
import { type RunColumn, RunsTable, jointOf, jointsOf } from "./runs_table";

const words = text.lists;
/** As many as there are marks. */
export const MOST_RUNS = 4;

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
  const { unit } = useSettings();
  const [first, second] = columns;
  const pair = useAction(async () => {
    if (!first || !second) return;
    const made = await compareSides([{ run: first.run }, { run: second.run }], false, false);
    go(link(["compare", "methods", made.id]));
  });
  const names = jointsOf(columns);
  const title = columns.map((column) => column.name).join(" · ");
  return (
    <>
      <div class="head">
        <Title kind={text.compare.title} plain={title}>
          {words.sideBySide(columns.length)}
        </Title>
        {columns.length === 2 && (
          <div class="actions">
            <ActionButton action={pair}>{words.test}</ActionButton>
          </div>
        )}
      </div>
      <section class="card">
        <RunsTable columns={columns} label={title} />
      </section>
      <Figure
        title={text.run.stiffness}
        note={text.run.stiffnessNote(percent(first?.run.request.confidence ?? 0.95))}
        legend={columns.map(({ run, name }, i) => ({ label: `${name}: ${how(run)}`, mark: `method-${i}` }))}
        table={stiffnessTable(
          columns.map(({ run, name }) => [`${name}: ${how(run)}`, run.result?.joints ?? []]),
          unit,
        )}
      >
        {(width) => (
          <StiffnessIntervals
            rows={names.map((name) => ({
              name,
              marks: columns.flatMap((column, i) => {
                const joint = jointOf(column, name);
                return joint ? [markOf(joint, `method-${i}`, unit)] : [];
              }),
            }))}
            {...{ width, unit }}
            label={text.run.stiffness}
          />
        )}
      </Figure>
    </>
  );
}
