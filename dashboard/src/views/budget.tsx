/** The uncertainty budget: what each joint's uncertainty consists of, relative to its compliance. */
import type { Budget, JointResult } from "../api/types";
import { DataTable } from "../components/table";
import { significant } from "../lib/format";
import { text } from "../i18n";

const words = text.budget;
const shown = (value: number) => significant(value, 2);

export function BudgetTable({ budget, joints }: { budget: Budget; joints: JointResult[] }) {
  const sizes = budget.joints.map((name) => joints.find((joint) => joint.name === name)?.compliance ?? null);
  /** In per cent of the compliance, which is that of the stiffness, too. */
  const relative = (values: number[]) =>
    values.map((value, j) => (sizes[j] ? (100 * value) / Math.abs(sizes[j]) : null));
  return (
    <section class="wide">
      <h3>{words.title}</h3>
      <p class="soft">{words.note}</p>
      <DataTable
        caption={words.title}
        table={{
          columns: [
            { title: words.source },
            { title: words.type },
            { title: words.included },
            ...budget.joints.map((name) => ({ title: name, unit: "%", show: shown })),
          ],
          rows: [
            ...budget.components.map((part) => [
              words.sources[part.source],
              part.evaluation,
              part.included ? words.yes : words.no,
              ...relative(part.contributions),
            ]),
            [words.combined, null, null, ...relative(budget.standard_uncertainty)],
            [
              words.expanded(significant(budget.coverage_factor, 3), budget.probability),
              null,
              null,
              ...relative(budget.expanded_uncertainty),
            ],
            [words.expandedAll(budget.missing), null, null, ...relative(budget.expanded_with_model_error)],
          ],
        }}
      />
      <h3>{words.correlation}</h3>
      <p class="soft">{words.correlationNote}</p>
      <DataTable
        caption={words.correlation}
        table={{
          columns: [{ title: text.run.joint }, ...budget.joints.map((name) => ({ title: name, show: shown }))],
          rows: budget.correlation.map((row, j) => [budget.joints[j] ?? "", ...row]),
        }}
      />
    </section>
  );
}
