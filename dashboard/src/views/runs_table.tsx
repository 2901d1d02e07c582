/** Runs as columns of a table: what each explains, its verdict, and each joint. */
import type { Run } from "../api/types";
import { Badge, NameLink, Name } from "../components/basics";
import { Scroll } from "../components/table";
import { fixed, percent } from "../lib/format";
import { shownStiffness } from "../lib/stiffness";
import { STIFFNESS_UNITS } from "../lib/units";
import { useSettings } from "../state/settings";
import { text } from "../i18n";

export interface RunColumn {
  run: Run;
  name: string;
  /** What else tells it from the others. */
  note?: string;
}

/** Names of all joints that any of the runs has. */
const jointsOf = (columns: RunColumn[]): string[] => [
  ...new Set(columns.flatMap(({ run }) => run.result?.joints.map((joint) => joint.name) ?? [])),
];

const jointOf = ({ run }: RunColumn, name: string) => run.result?.joints.find((joint) => joint.name === name);

export function RunsTable({ columns, label }: { columns: RunColumn[]; label: string }) {
  const { unit } = useSettings();
  const row = (title: string, cell: (column: RunColumn) => preact.ComponentChildren, note?: string) => (
    <tr>
      <th scope="row">
        <Name>{title}</Name> {note && <small class="soft">{note}</small>}
      </th>
      {columns.map((column) => (
        <td>{cell(column) ?? "–"}</td>
      ))}
    </tr>
  );
  return (
    <Scroll label={label}>
      <table class="side-by-side">
        <thead>
          <tr>
            <th scope="col" />
            {columns.map(({ run, name, note }) => (
              <th scope="col">
                <NameLink to={["runs", run.id]}>{name}</NameLink>
                {note && <small class="soft">{note}</small>}
              </th>
            ))}
          </tr>
        </thead>
        <tbody>
          {row(text.run.verdict, ({ run }) => run.result && <Badge verdict={run.result.assessment.verdict} />)}
          {row(text.lists.explainedTitle, ({ run }) => {
            const share = run.result?.compensation ?? null;
            return share === null ? null : percent(share);
          })}
          {row(text.lists.rms, ({ run }) => run.result && fixed(run.result.rms_residual * 1e3, 3), text.units.mm)}
          {jointsOf(columns).map((name) =>
            row(
              name,
              (column) => {
                const joint = jointOf(column, name);
                const shown = joint && shownStiffness(joint, unit);
                return (
                  <>
                    <b>{shown?.value ?? shown?.limit ?? "–"}</b>
                    {shown?.uncertainty && <span class="soft"> ±&nbsp;{shown.uncertainty}</span>}
                  </>
                );
              },
              STIFFNESS_UNITS[unit].label,
            ),
          )}
        </tbody>
      </table>
    </Scroll>
  );
}
