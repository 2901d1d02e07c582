/** Methods side by side on one set: the layout of the paper's Table II, and the same as a chart. */
import { useState } from "preact/hooks";
import { api } from "../api/client";
import type { ComparedFit, JointResult } from "../api/types";
import { Figure } from "../charts/figure";
import { StiffnessIntervals, markOf } from "../charts/intervals";
import { Download, Choice, Name, Prose } from "../components/basics";
import { JobPage } from "../components/job_page";
import { Term } from "../components/term";
import { alike, Scroll, type Table } from "../components/table";
import { decimalsFor, fixed, percent, significant } from "../lib/format";
import { unsaid } from "../lib/said";
import { shownStiffness } from "../lib/stiffness";
import { STIFFNESS_UNITS, type StiffnessUnit, changeIn, inUnit, intervalIn, maybeInUnit } from "../lib/units";
import { storedSet } from "../state/stored";
import { link } from "../state/router";
import { useSettings } from "../state/settings";
import { text } from "../i18n";
import { Further } from "../components/findings";
import { VerdictCard } from "./verdict_card";

const words = text.compare;

export function ComparisonView({ id }: { id: string }) {
  return (
    <JobPage
      collection="comparisons"
      id={id}
      kind={words.methods}
      load={async (signal) => {
        const comparison = await api.comparisons.one(id, signal);
        return { job: comparison, set: await storedSet(comparison.request.measurement_set_id) };
      }}
      head={({ job, set }) => ({
        name: set.name,
        list: "#/compare/methods",
        about: <a href={link(["sets", set.id])}>{text.sets.kind}</a>,
        actions: job.result && <Download href={api.comparisons.file(id, "table.csv")}>{text.figure.csv}</Download>,
      })}
    >
      {({ assessment, warnings, entries }, { job }) => (
        <>
          <VerdictCard assessment={assessment} context={null} />
          <Further warnings={unsaid(warnings, assessment.reasons)} />
          <TableTwo entries={entries} />
          <Methods entries={entries} level={percent(job.request.confidence ?? 0.95)} />
        </>
      )}
    </JobPage>
  );
}

/** A name that tells an entry from the others. */
function entryName(fit: ComparedFit): string {
  const short = text.methods[fit.method];
  if (fit.weighting !== "characteristic_length") return short;
  return fit.characteristic_length
    ? `${short}, ${words.lengthOf(significant(fit.characteristic_length * 1e3, 2))}`
    : `${short}, ${words.byLength}`;
}

const jointNames = (entries: ComparedFit[]): string[] => [
  ...new Set(entries.flatMap((entry) => entry.joints.map((joint) => joint.name))),
];

function TableTwo({ entries }: { entries: ComparedFit[] }) {
  const { unit } = useSettings();
  const joints = jointNames(entries);
  const shown = merged(entries);
  return (
    <section class="card">
      <h2>
        {words.tableTitle} <small class="soft">{STIFFNESS_UNITS[unit].label}</small>
      </h2>
      <p class="soft">{words.tableNote}</p>
      <Scroll label={words.tableTitle}>
        <table class="two">
          <thead>
            <tr>
              <th scope="col">{text.run.method}</th>
              {joints.map((joint) => (
                <th scope="col">
                  <Name>{joint}</Name>
                </th>
              ))}
              <th scope="col">{words.compensation}</th>
              <th scope="col">
                {words.rms} [{text.units.mm}]
              </th>
            </tr>
          </thead>
          <tbody>
            {shown.map(({ fit, both }) => (
              <Row fit={fit} joints={joints} unit={unit} both={both} />
            ))}
          </tbody>
        </table>
      </Scroll>
    </section>
  );
}

/** The fits, those once whose constraints change no number. */
function merged(entries: ComparedFit[]): { fit: ComparedFit; both: boolean }[] {
  const numbers = ({ positive: _, assessment: _a, ...rest }: ComparedFit) => JSON.stringify(rest);
  const free = new Set(entries.filter((fit) => !fit.positive).map(numbers));
  const constrained = new Set(entries.filter((fit) => fit.positive).map(numbers));
  return entries.flatMap((fit) => {
    const both = free.has(numbers(fit)) && constrained.has(numbers(fit));
    return both && !fit.positive ? [] : [{ fit, both }];
  });
}

function Row({
  fit,
  joints,
  unit,
  both,
}: {
  fit: ComparedFit;
  joints: string[];
  unit: StiffnessUnit;
  /** Whether the fit without constraints has the same numbers. */
  both: boolean;
}) {
  return (
    <tr class={both ? "both" : fit.positive ? "positive" : "free"}>
      <th scope="row">
        <Term of={fit.method}>{entryName(fit)}</Term>
        <small class="soft">
          {both ? words.alike : fit.positive ? text.options.constrained : text.options.unconstrained}
        </small>
      </th>
      {fit.error ? (
        <td colSpan={joints.length + 2}>
          {words.notPossible}: <Prose text={fit.error.detail} />
        </td>
      ) : (
        <>
          {joints.map((name) => (
            <td class="number" data-label={name}>
              <Cell fit={fit} name={name} unit={unit} />
            </td>
          ))}
          <td class="number" data-label={words.compensation}>
            {fit.compensation === null ? "–" : percent(fit.compensation)}
          </td>
          <td class="number" data-label={`${words.rms} [${text.units.mm}]`}>
            {fit.rms_residual === null ? "–" : fixed(fit.rms_residual * 1e3, 3)}
          </td>
        </>
      )}
    </tr>
  );
}

function Cell({ fit, name, unit }: { fit: ComparedFit; name: string; unit: StiffnessUnit }) {
  const draws = fit.resampling?.joints.find((joint) => joint.name === name);
  if (draws && draws.stiffness_mean !== null && draws.stiffness_deviation !== null) {
    const deviation = changeIn(draws.stiffness_deviation, draws.stiffness_mean, unit);
    const decimals = decimalsFor(deviation);
    return (
      <span class={draws.stiffness_mean < 0 ? "bad" : undefined}>
        {fixed(inUnit(draws.stiffness_mean, unit), decimals)}{" "}
        <span class="soft spread">±&nbsp;{fixed(deviation, decimals)}</span>
        {draws.share_negative > 0 && (
          <small class="bad">
            {" "}
            {percent(draws.share_negative)} {words.anyNegative}
          </small>
        )}
      </span>
    );
  }
  const joint = fit.joints.find((found) => found.name === name);
  return joint ? <Value joint={joint} unit={unit} /> : <>–</>;
}

function Value({ joint, unit }: { joint: JointResult; unit: StiffnessUnit }) {
  const shown = shownStiffness(joint, unit);
  if (shown.value === null) return <span class="soft">{shown.limit === null ? "–" : shown.limit}</span>;
  const negative = joint.stiffness !== null && joint.stiffness < 0;
  return (
    <span class={negative ? "bad" : undefined}>
      {shown.value}
      {shown.uncertainty !== null && <span class="soft spread"> ±&nbsp;{shown.uncertainty}</span>}
    </span>
  );
}

function Methods({ entries, level }: { entries: ComparedFit[]; level: string }) {
  const { unit } = useSettings();
  const [constraint, setConstraint] = useState<"positive" | "unconstrained">("positive");
  const chosen = entries.filter((fit) => fit.positive === (constraint === "positive") && !fit.error);
  if (entries.every((fit) => fit.error)) return null;
  const rows = jointNames(entries).map((name) => ({
    name,
    marks: chosen.flatMap((fit, i) =>
      fit.joints.filter((joint) => joint.name === name).map((joint) => markOf(joint, `method-${i}`, unit)),
    ),
  }));
  return (
    <Figure
      title={words.chartTitle}
      note={text.run.stiffnessNote(level)}
      table={table(entries, unit)}
      legend={chosen.map((fit, i) => ({ label: entryName(fit), mark: `method-${i}` }))}
      tools={
        <Choice
          label={text.run.method}
          value={constraint}
          change={setConstraint}
          options={{ positive: text.options.constrained, unconstrained: text.options.unconstrained }}
        />
      }
    >
      {(width) => <StiffnessIntervals {...{ rows, width, unit, label: words.chartTitle }} />}
    </Figure>
  );
}

function table(entries: ComparedFit[], unit: StiffnessUnit): Table {
  const { column } = STIFFNESS_UNITS[unit];
  return {
    columns: [
      text.run.method,
      text.options.constrained,
      text.run.joint,
      ...alike([text.run.value, text.run.low, text.run.high], column),
      words.compensation,
      { title: words.rms, unit: text.units.mm },
    ],
    rows: entries.flatMap((fit) =>
      fit.joints.map((joint) => [
        entryName(fit),
        fit.positive ? text.options.constrained : text.options.unconstrained,
        joint.name,
        maybeInUnit(joint.stiffness, unit),
        ...intervalIn(joint.stiffness_interval, unit),
        fit.compensation,
        fit.rms_residual === null ? null : fit.rms_residual * 1e3,
      ]),
    ),
  };
}
