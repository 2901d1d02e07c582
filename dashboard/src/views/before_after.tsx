/** A run beside the one that it tries to improve: what was changed, and what came of it. */
import type { JointResult, Run } from "../api/types";
import { Badge } from "../components/badge";
import { Name } from "../components/basics";
import { fixed, percent } from "../lib/format";
import { shownStiffness } from "../lib/stiffness";
import { STIFFNESS_UNITS, type StiffnessUnit } from "../lib/units";
import { useCached } from "../state/cache";
import { valueOf } from "../state/load";
import { link } from "../state/router";
import { useSettings } from "../state/settings";
import { api } from "../api/client";
import { text } from "../i18n";

const words = text.assessment;

export function BeforeAfter({ run, origin }: { run: Run; origin: string }) {
  const before = valueOf(useCached(`run/${origin}`, () => api.runs.one(origin), Number.POSITIVE_INFINITY));
  const { unit } = useSettings();
  if (!before?.result || !run.result) return null;
  const [was, is] = [before.result, run.result];
  const later = new Map(is.joints.map((joint) => [joint.name, joint]));
  return (
    <section class="card before-after">
      <h2>
        {words.beforeAfter} <small class="soft">{changes(before, run).join(", ")}</small>
      </h2>
      <div class="scroll" tabIndex={0} role="region" aria-label={words.beforeAfter}>
        <table>
          <thead>
            <tr>
              <th scope="col" />
              <th scope="col">
                <a href={link(["runs", before.id])}>{words.before}</a>
              </th>
              <th scope="col">{words.after}</th>
            </tr>
          </thead>
          <tbody>
            <tr>
              <th scope="row">{text.run.verdict}</th>
              <td>
                <Badge verdict={was.assessment.verdict} />
              </td>
              <td>
                <Badge verdict={is.assessment.verdict} />
              </td>
            </tr>
            <Line name={text.lists.explainedTitle} before={share(was.compensation)} after={share(is.compensation)} />
            <Line
              name={`${text.compare.rms} [${text.units.mm}]`}
              before={fixed(was.rms_residual * 1e3, 3)}
              after={fixed(is.rms_residual * 1e3, 3)}
            />
            {was.joints.map((joint) => (
              <Line
                name={joint.name}
                unit={STIFFNESS_UNITS[unit].label}
                before={value(joint, unit)}
                after={value(later.get(joint.name), unit)}
              />
            ))}
          </tbody>
        </table>
      </div>
    </section>
  );
}

function Line({ name, unit, before, after }: { name: string; unit?: string; before: string; after: string }) {
  return (
    <tr>
      <th scope="row">
        <Name>{name}</Name> {unit && <small class="soft">{unit}</small>}
      </th>
      <td>{before}</td>
      <td>
        <b>{after}</b>
      </td>
    </tr>
  );
}

const share = (value: number | null): string => (value === null ? "–" : percent(value));

function value(joint: JointResult | undefined, unit: StiffnessUnit): string {
  if (!joint) return "–";
  const shown = shownStiffness(joint, unit);
  if (shown.value === null) return shown.limit ?? "–";
  return shown.uncertainty === null ? shown.value : `${shown.value} ±\u00a0${shown.uncertainty}`;
}

/** What differs between two runs, in words. */
export function changes(before: Run, after: Run): string[] {
  const [a, b] = [before.request, after.request];
  const left = b.leave_out.filter((label) => !a.leave_out.includes(label));
  return [
    ...(left.length > 0 ? [words.changed.leftOut(left)] : []),
    ...(a.loss !== b.loss ? [words.changed.loss[b.loss === "automatic" ? "chosen" : b.loss]] : []),
    ...(a.complementary_stiffness !== b.complementary_stiffness
      ? [words.changed.complementary[b.complementary_stiffness]]
      : []),
    ...(a.measurement_set_id !== b.measurement_set_id ? [words.changed.set] : []),
  ];
}
