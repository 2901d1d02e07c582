/** The first tab of a result: whether it may be used, what it comes to, and each joint. */
import type { Run, RunResult } from "../api/types";
import { Shares } from "../charts/bars";
import { Figure } from "../charts/figure";
import { JobTables } from "../components/job_tables";
import { percent, significant } from "../lib/format";
import { text } from "../i18n";
import { useCached, valueOf } from "../state/load";
import { api } from "../api/client";
import { RunsTable } from "./runs_table";
import { useState } from "preact/hooks";
import { ActionButton } from "../components/basics";
import { unsaid } from "../lib/said";
import { freshKey } from "../lib/hash";
import { useAction } from "../state/action";
import { JointTable } from "./joint_table";
import { Further } from "../components/findings";
import { type RunContext, isElastic } from "./run_context";
import { Evidence } from "./run_evidence";
import { VerdictCard } from "./verdict_card";

export function StiffnessPart({ context, result }: { context: RunContext; result: RunResult }) {
  const { run } = context;
  const nothing = result.joints.every((joint) => joint.status !== "identified" && joint.status !== "uncertain");
  const [beside, setBeside] = useState<Run | null>(null);
  const other = useAction(async () => setBeside(beside ? null : await otherConstraint(run)));
  const positive = run.request.positive;
  return (
    <>
      <VerdictCard assessment={result.assessment} context={context} />
      {run.request.variant_of !== null && <BeforeAfter run={run} origin={run.request.variant_of} />}
      {!nothing && <Summary result={result} />}
      <JointTable
        context={context}
        result={result}
        beside={beside}
        bare={nothing}
        tools={
          isElastic(run) || nothing ? null : (
            <ActionButton action={other} going={text.run.besideWorking}>
              {beside ? text.run.besideOff : text.run.beside(!positive)}
            </ActionButton>
          )
        }
      />
      {result.links && <ElementShares links={result.links} />}
      {result.selection && (
        <p class="note">
          {linksWords.thisRun(text.elasticities[result.selection.chosen], text.losses[result.selection.chosen_loss])}{" "}
          {linksWords.selected(text.elasticities[result.selection.simplest], text.elasticities[result.selection.best])}
        </p>
      )}
      {(result.links || result.selection || result.resampling) && <JobTables collection="runs" id={run.id} from={1} />}
      <Further warnings={unsaid(result.warnings, result.assessment.reasons)} />
      <Evidence context={context} result={result} />
    </>
  );
}

/** The same run with the other constraint: found in the list, or asked for. */
async function otherConstraint(run: Run): Promise<Run> {
  const wanted = { ...run.request, positive: !run.request.positive };
  const plain = JSON.stringify({ ...wanted, resampling: null });
  const page = await api.runs.list({
    measurement_set_id: run.request.measurement_set_id,
    method: run.request.method,
    state: "succeeded",
    limit: 50,
  });
  for (const summary of page.items.filter((item) => item.positive === wanted.positive).slice(0, 8)) {
    const found = await api.runs.one(summary.id);
    if (JSON.stringify({ ...wanted, ...found.request, resampling: null }) === plain) return found;
  }
  return api.runs.add({ ...wanted, resampling: null }, freshKey("run"));
}

function Summary({ result }: { result: RunResult }) {
  const words = text.run.summary;
  const found = result.joints.filter((joint) => joint.stiffness !== null).length;
  const { goodness } = result;
  const noise =
    goodness.sigma_source === "residuals" || !goodness.test
      ? words.noiseEstimated
      : goodness.test.verdict === "consistent"
        ? words.noiseFits
        : goodness.test.verdict === "residuals_too_large"
          ? words.noiseLarge
          : words.noiseSmall;
  const figure = (value: string | number, unit: string, said: string) => (
    <li>
      <b>
        {value}
        <small> {unit}</small>
      </b>{" "}
      {said}
    </li>
  );
  return (
    <ul class="summary">
      {figure(found, words.of(result.joints.length), words.numbered)}
      {result.compensation !== null && figure(percent(result.compensation), "", words.compensation)}
      {figure(significant(result.rms_residual * 1e3, 2), text.units.mm, words.rms)}
      {figure(result.sigma === null ? "–" : significant(result.sigma * 1e6, 2), `${text.units.micrometre} σ`, noise)}
    </ul>
  );
}

const words = text.assessment;

/** A run beside the one that it tries to improve: what was changed, and what came of it. */
function BeforeAfter({ run, origin }: { run: Run; origin: string }) {
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
function changes(before: Run, after: Run): string[] {
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

const linksWords = text.links;
type Links = NonNullable<RunResult["links"]>;

/** Where more than joints may bend: what each joint and link explains, and which model the readings call for. */
function ElementShares({ links }: { links: Links }) {
  const named = links.elements.map(({ kind, joint, share }) => ({
    name: joint === null ? linksWords.kinds[kind] : kind === "link" ? linksWords.link(joint) : joint,
    share,
    note: "",
  }));
  const rows = [...named, { name: linksWords.unexplained, share: links.unexplained, note: "" }];
  return (
    <Figure
      title={linksWords.elements}
      note={`${linksWords.elementsNote} ${linksWords.chosenBy(
        linksWords.sources[links.model_source],
        `${text.losses[links.loss]} ${linksWords.sources[links.loss_source]}`,
        `${significant(links.penalty, 2)} ${linksWords.sources[links.penalty_source]}`,
      )}`}
    >
      {(width) => <Shares shares={rows} width={width} label={linksWords.elements} />}
    </Figure>
  );
}
