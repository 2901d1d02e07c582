/** A run beside the one that it tries to improve: what was changed, and what came of it. */
import type { Run } from "../api/types";
import { useCached } from "../state/cache";
import { valueOf } from "../state/load";
import { api } from "../api/client";
import { text } from "../i18n";
import { RunsTable } from "./runs_table";

const words = text.assessment;

export function BeforeAfter({ run, origin }: { run: Run; origin: string }) {
  const before = valueOf(useCached(`run/${origin}`, () => api.runs.one(origin), Number.POSITIVE_INFINITY));
  if (!before?.result || !run.result) return null;
  const columns = [
    { run: before, name: words.before },
    { run, name: words.after },
  ];
  return (
    <section class="card before-after">
      <h2>
        {words.beforeAfter} <small class="soft">{changes(before, run).join(", ")}</small>
      </h2>
      <RunsTable columns={columns} label={words.beforeAfter} />
    </section>
  );
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
