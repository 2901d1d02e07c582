/** The first tab of a result: whether it may be used, what it comes to, and each joint. */
import { useState } from "preact/hooks";
import { api } from "../api/client";
import type { Run, RunResult } from "../api/types";
import { ActionButton, LinkButton } from "../components/basics";
import { TableCard } from "../components/table";
import { percent, significant } from "../lib/format";
import { unsaid } from "../lib/said";
import { freshKey } from "../lib/hash";
import { changeIn, maybeInUnit, STIFFNESS_UNITS } from "../lib/units";
import { useAction } from "../state/action";
import { link } from "../state/router";
import { useSettings } from "../state/settings";
import { text } from "../i18n";
import { JointTable } from "./joint_table";
import { BeforeAfter } from "./before_after";
import { Further } from "./further";
import { isElastic, type RunContext } from "./run_context";
import { Evidence } from "./run_evidence";
import { ElementShares, ModelChoice } from "./run_links";
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
      <nav class="actions" aria-label={text.run.uses}>
        {(["predict", "map", "program", "report"] as const).map((part) => (
          <LinkButton href={link(["runs", run.id, part])}>{text.run.views[part]}</LinkButton>
        ))}
      </nav>
      {result.links && <ElementShares links={result.links} />}
      {result.selection && <ModelChoice selection={result.selection} />}
      {result.resampling && <Resampled result={result} />}
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
  return (
    <ul class="summary">
      <li>
        <b>
          {found}
          <small> {words.of(result.joints.length)}</small>
        </b>{" "}
        {words.numbered}
      </li>
      {result.compensation !== null && (
        <li>
          <b>{percent(result.compensation)}</b> {words.compensation}
        </li>
      )}
      <li>
        <b>
          {significant(result.rms_residual * 1e3, 2)}
          <small> {text.units.mm}</small>
        </b>{" "}
        {words.rms}
      </li>
      <li>
        <b>
          {result.sigma === null ? "–" : significant(result.sigma * 1e6, 2)}
          <small> {text.units.micrometre} σ</small>
        </b>
        {noise}
      </li>
    </ul>
  );
}

function Resampled({ result }: { result: RunResult }) {
  const { unit } = useSettings();
  const { column } = STIFFNESS_UNITS[unit];
  const draws = result.resampling;
  if (!draws) return null;
  return (
    <TableCard
      title={text.run.resampling}
      note={text.run.resamplingNote(draws.repetitions)}
      table={{
        columns: [
          { title: text.run.joint },
          { title: text.run.mean, unit: column },
          { title: text.run.deviation, unit: column, show: (v) => significant(v, 2) },
          { title: text.run.negativeDraws, show: (v) => percent(v) },
          { title: text.run.infiniteDraws, show: (v) => percent(v) },
        ],
        rows: draws.joints.map((joint) => [
          joint.name,
          maybeInUnit(joint.stiffness_mean, unit),
          joint.stiffness_mean === null || joint.stiffness_deviation === null
            ? null
            : changeIn(joint.stiffness_deviation, joint.stiffness_mean, unit),
          joint.share_negative,
          joint.share_infinite,
        ]),
      }}
    />
  );
}
