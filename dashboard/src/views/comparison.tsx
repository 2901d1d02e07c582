/** Methods side by side on one set: the layout of the paper's Table II, and the same as a chart. */
import { useState } from "preact/hooks";
import { api } from "../api/client";
import type { ComparedFit } from "../api/types";
import { Figure } from "../charts/figure";
import { StiffnessIntervals, markOf } from "../charts/intervals";
import { Download, Choice, Prose } from "../components/basics";
import { JobPage } from "../components/job_page";
import { JobTables } from "../components/job_tables";
import { alike, type Table } from "../components/table";
import { percent, significant } from "../lib/format";
import { unsaid } from "../lib/said";
import { STIFFNESS_UNITS, type StiffnessUnit, intervalIn, maybeInUnit } from "../lib/units";
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
        actions: job.result && <Download href={api.jobs.file(id, "table.csv")}>{text.figure.csv}</Download>,
      })}
    >
      {({ assessment, warnings, entries }, { job }) => (
        <>
          <VerdictCard assessment={assessment} context={null} />
          <Further warnings={unsaid(warnings, assessment.reasons)} />
          <JobTables collection="comparisons" id={job.id} />
          {entries.map(
            (fit) =>
              fit.error && (
                <p class="note">
                  {entryName(fit)}: {words.notPossible}: <Prose text={fit.error.detail} />
                </p>
              ),
          )}
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
