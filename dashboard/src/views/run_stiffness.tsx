/** The first part of a result: warnings, what it comes to, each joint's stiffness, what each contributes. */
import { useState } from "preact/hooks";
import { api } from "../api/client";
import type { JointResult, Run, RunResult } from "../api/types";
import { Shares } from "../charts/bars";
import { Figure } from "../charts/figure";
import { type IntervalMark, Intervals } from "../charts/intervals";
import { Name, ProblemNote, Warnings } from "../parts/basics";
import { DataTable } from "../parts/table";
import { fixed, percent, significant } from "../pure/format";
import { freshKey } from "../pure/hash";
import { axisStiffness, shownStiffness } from "../pure/stiffness";
import { STIFFNESS_UNITS, type StiffnessUnit } from "../pure/units";
import { verdictOf } from "../pure/verdict";
import { useAction } from "../state/action";
import { useSettings } from "../state/settings";
import { text } from "../text";
import { isElastic, type RunContext } from "./run_context";
import { ElementShares, ModelChoice } from "./run_links";

export function StiffnessPart({ context, result }: { context: RunContext; result: RunResult }) {
  const { run } = context;
  const [beside, setBeside] = useState<Run | null>(null);
  const other = useAction(async () => setBeside(beside ? null : await otherConstraint(run)));
  const positive = run.request.positive !== false;
  return (
    <>
      {result.warnings.length > 0 && (
        <section aria-label={text.run.warnings(result.warnings.length)}>
          <h2>{text.run.warnings(result.warnings.length)}</h2>
          <Warnings warnings={result.warnings} />
        </section>
      )}
      <Summary result={result} />
      <StiffnessFigure
        run={run}
        result={result}
        beside={beside}
        tools={
          isElastic(run) ? null : (
            <button type="button" class="button" disabled={other.busy} onClick={other.run}>
              {other.busy ? text.run.besideWorking : beside ? text.run.besideOff : text.run.beside(!positive)}
            </button>
          )
        }
      />
      {other.problem && <ProblemNote problem={other.problem} />}
      <Joints result={result} />
      {result.links ? <ElementShares links={result.links} /> : <Contributions result={result} />}
      {result.selection && <ModelChoice selection={result.selection} />}
      {result.resampling && <Resampled result={result} />}
    </>
  );
}

/** The same run with the other constraint: found in the list, or asked for. */
async function otherConstraint(run: Run): Promise<Run> {
  const wanted = { ...run.request, positive: run.request.positive === false };
  const plain = JSON.stringify({ ...wanted, resampling: null });
  const page = await api.runs({
    measurement_set_id: run.request.measurement_set_id,
    method: run.request.method,
    state: "succeeded",
    limit: 50,
  });
  for (const summary of page.items.filter((item) => item.positive === wanted.positive).slice(0, 8)) {
    const found = await api.run(summary.id);
    if (JSON.stringify({ ...wanted, ...found.request, resampling: null }) === plain) return found;
  }
  return api.addRun({ ...wanted, resampling: null }, freshKey("run"));
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

function StiffnessFigure({
  run,
  result,
  beside,
  tools,
}: {
  run: Run;
  result: RunResult;
  beside: Run | null;
  tools: preact.ComponentChildren;
}) {
  const { unit } = useSettings();
  const positive = run.request.positive !== false;
  const level = percent(run.request.confidence ?? 0.95);
  const others = new Map(beside?.result?.joints.map((joint) => [joint.name, joint]));
  const rows = result.joints.map((joint) => ({
    name: joint.name,
    marks: [
      markOf(joint, positive ? "positive" : "free", unit),
      ...(others.has(joint.name)
        ? [markOf(others.get(joint.name) as JointResult, positive ? "free" : "positive", unit)]
        : []),
    ],
  }));
  const legend = beside
    ? [
        { label: `${text.run.chosen}: ${text.run.other(positive)}`, mark: positive ? "positive" : "free" },
        { label: text.run.other(!positive), mark: positive ? "free" : "positive" },
      ]
    : [];
  return (
    <Figure
      title={text.run.stiffness}
      note={text.run.stiffnessNote(level)}
      legend={legend}
      tools={tools}
      table={stiffnessTable(
        [
          [text.run.other(positive), result.joints],
          ...(beside?.result ? [[text.run.other(!positive), beside.result.joints] as [string, JointResult[]]] : []),
        ],
        unit,
      )}
    >
      {(width) => (
        <Intervals
          rows={rows}
          width={width}
          label={text.run.stiffness}
          unit={STIFFNESS_UNITS[unit].label}
          format={axisStiffness(unit)}
        />
      )}
    </Figure>
  );
}

export function markOf(joint: JointResult, mark: string, unit: StiffnessUnit): IntervalMark {
  const shown = shownStiffness(joint, unit);
  const negative = joint.stiffness !== null && joint.stiffness < 0;
  const interval = joint.stiffness_interval;
  const words = verdictOf(joint);
  const instead = negative ? `${text.run.negative}: ${shown.value ?? ""}` : text.verdicts[words];
  return {
    mark,
    value: negative ? null : joint.stiffness,
    low: interval?.[0] ?? (negative ? null : joint.stiffness),
    high: interval ? interval[1] : joint.stiffness,
    instead: instead ?? null,
    label: `${joint.name}: ${shown.value ?? instead ?? ""} ${STIFFNESS_UNITS[unit].label}`,
  };
}

export function stiffnessTable(sets: [string, JointResult[]][], unit: StiffnessUnit) {
  const { factor, column } = STIFFNESS_UNITS[unit];
  const scaled = (value: number | null | undefined) => (value === null || value === undefined ? null : value * factor);
  const u = { unit: column };
  const words = text.run;
  return {
    columns: [
      { title: words.joint },
      { title: words.verdict },
      { title: text.options.constrained },
      { title: words.value, ...u },
      { title: `${words.uncertainty}(k)`, ...u },
      { title: words.low, ...u },
      { title: words.high, ...u },
    ],
    rows: sets.flatMap(([name, joints]) =>
      joints.map((joint) => [
        joint.name,
        text.verdicts[verdictOf(joint)] ?? "",
        name,
        scaled(joint.stiffness),
        joint.stiffness === null || joint.standard_uncertainty === null
          ? null
          : joint.stiffness ** 2 * joint.standard_uncertainty * factor,
        scaled(joint.stiffness_interval?.[0]),
        scaled(joint.stiffness_interval?.[1]),
      ]),
    ),
  };
}

function Joints({ result }: { result: RunResult }) {
  const { unit } = useSettings();
  return (
    <ul class="joints" aria-label={text.run.stiffness}>
      {result.joints.map((joint) => (
        <JointCard joint={joint} unit={unit} />
      ))}
    </ul>
  );
}

function JointCard({ joint, unit }: { joint: JointResult; unit: StiffnessUnit }) {
  const shown = shownStiffness(joint, unit);
  const verdict = verdictOf(joint);
  const { label } = STIFFNESS_UNITS[unit];
  const only = verdict === "lower_limit" && shown.limit !== null;
  return (
    <li class={`joint ${verdict}`}>
      <h3>
        <Name>{joint.name}</Name>
      </h3>
      <p class="value">
        {verdict === "unobservable" ? (
          <b>–</b>
        ) : only ? (
          <>
            <small>≥</small> <b>{shown.limit}</b>
          </>
        ) : (
          <b>{shown.value ?? "∞"}</b>
        )}
        {!only && shown.uncertainty !== null && <span class="soft"> ± {shown.uncertainty}</span>}
        {verdict !== "unobservable" && <small class="unit">{label}</small>}
        {!only && shown.uncertainty !== null && <small class="unit">{text.run.standardUncertainty}</small>}
      </p>
      <p class="verdict">
        <span class="lamp" aria-hidden="true" />
        {text.verdicts[verdict]}
      </p>
      <p class="soft">{joint.reason ?? text.verdictHints[verdict]}</p>
    </li>
  );
}

function Contributions({ result }: { result: RunResult }) {
  const parts = result.contributions ?? [];
  if (parts.every(({ mean }) => mean === 0)) return null;
  const unseen = new Set(result.joints.filter((joint) => joint.compliance === null).map((joint) => joint.name));
  const rows = parts.map(({ joint, share, mean }) => ({
    name: joint,
    share,
    note: unseen.has(joint) ? text.run.rigid : `${fixed(mean * 1e3, 3)} ${text.units.mm}`,
  }));
  return (
    <Figure
      title={text.run.contributions}
      note={text.run.contributionsNote}
      table={{
        columns: [
          { title: text.run.joint },
          { title: text.run.contributionShare, show: (v) => percent(v) },
          { title: text.run.contributionMean, unit: text.units.mm },
        ],
        rows: parts.map(({ joint, share, mean }) => [joint, share, mean * 1e3]),
      }}
    >
      {(width) => <Shares shares={rows} width={width} label={text.run.contributions} />}
    </Figure>
  );
}

function Resampled({ result }: { result: RunResult }) {
  const { unit } = useSettings();
  const { factor, column } = STIFFNESS_UNITS[unit];
  const draws = result.resampling;
  if (!draws) return null;
  const scaled = (value: number | null) => (value === null ? null : value * factor);
  return (
    <section class="card">
      <h2>{text.run.resampling}</h2>
      <p class="soft">{text.run.resamplingNote(draws.repetitions)}</p>
      <DataTable
        caption={text.run.resampling}
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
            scaled(joint.stiffness_mean),
            scaled(joint.stiffness_deviation),
            joint.share_negative,
            joint.share_infinite,
          ]),
        }}
      />
    </section>
  );
}
