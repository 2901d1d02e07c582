/** Runs side by side: methods on one set, and two sets with the ratios of their stiffnesses; the paper's figures. */
import { useState } from "preact/hooks";
import { api } from "../api/client";
import type { ComparedRun, Comparison } from "../api/types";
import { BarFigure } from "../charts/bars";
import { Figure } from "../charts/figure";
import { Intervals } from "../charts/intervals";
import { Choice, Download, LinkButton, Name, NameLink, Prose } from "../components/basics";
import { Further } from "../components/findings";
import { JobPage } from "../components/job_page";
import { JobTables } from "../components/job_tables";
import { percent, significant } from "../lib/format";
import { unsaid } from "../lib/said";
import { link } from "../state/router";
import { storedSet } from "../state/names";
import { text } from "../i18n";
import { later } from "../i18n/later";
import { StiffnessFigure } from "./joint_table";
import { VerdictCard } from "./verdict_card";

const words = later.compare;
const two = later.pair;
type Result = NonNullable<Comparison["result"]>;
type Avoided = NonNullable<Result["avoided"]>;
/** Names of the sides: one set, or two. */
type Sides = readonly string[];

export function ComparisonView({ id }: { id: string }) {
  return (
    <JobPage
      collection="comparisons"
      id={id}
      kind={words.title}
      load={async (signal) => {
        const job = await api.comparisons.one(id, signal);
        const ids = [job.first_set_id, ...(job.second_set_id ? [job.second_set_id] : [])];
        const sets = await Promise.all(ids.map(storedSet));
        const names = sets.map((set) => set.name);
        const same = new Set(names).size < names.length;
        const sides = names.map((name, i) => (same ? `${name} (${i ? two.second : two.first})` : name));
        return { job, ids, sides };
      }}
      head={({ job, ids, sides }) => ({
        name: sides.join(" → "),
        title: sides.map((name, i) => (
          <>
            {i > 0 && " → "}
            <Name>{name}</Name>
          </>
        )),
        list: `#/compare/${sides.length > 1 ? "pairs" : "methods"}`,
        about: sides.map((name, i) => <NameLink to={["sets", ids[i] ?? ""]}>{name}</NameLink>),
        actions: job.result && (
          <>
            <Download href={api.jobs.file(id, "table.csv")}>{text.figure.csv}</Download>
            {job.result.sides.length > 1 && <Swap sides={job.result.sides.map((side) => `run:${side.run_id}`)} />}
          </>
        ),
      })}
    >
      {(result, { job, sides }) => <ComparisonPage id={job.id} {...{ result, sides }} />}
    </JobPage>
  );
}

const Swap = ({ sides: [first = "", second = ""] }: { sides: string[] }) => (
  <LinkButton href={link(["compare", "pairs"], { first: second, second: first })}>{two.swap}</LinkButton>
);

function ComparisonPage({ id, result, sides }: { id: string; result: Result; sides: Sides }) {
  const level = percent(result.confidence);
  const { assessment, warnings, entries, avoided } = result;
  const paired = avoided !== null;
  return (
    <>
      <VerdictCard assessment={assessment} context={null} />
      <Further warnings={unsaid(warnings, assessment.reasons)} />
      {avoided && <AvoidedShare avoided={avoided} />}
      {paired && <Ratios {...{ result, sides, level }} />}
      {paired && (
        <StiffnessFigure
          title={two.stiffness}
          level={level}
          series={result.sides.map(({ run_id: run }, i) => ({
            label: sides[i] ?? "",
            mark: i ? "method-0" : "method-1",
            joints: entries.find((fit) => fit.run_id === run)?.joints ?? [],
          }))}
        />
      )}
      <JobTables collection="comparisons" id={id} />
      {entries.map(
        (fit) =>
          fit.error && (
            <p class="note">
              {entryName(fit)}: {words.notPossible}: <Prose text={fit.error.detail} />
            </p>
          ),
      )}
      {sides.map((side, i) => {
        const own = entries.filter((fit) => fit.side === (i ? "second" : "first") && !fit.error);
        return own.length > 2 || !paired ? <Methods entries={own} level={level} side={paired ? side : null} /> : null;
      })}
      {paired && <Deflections result={result} sides={sides} />}
      {sides.map((side, i) => (
        <Left result={result} at={i} side={paired ? side : null} />
      ))}
      {avoided && <ByConfiguration avoided={avoided} />}
    </>
  );
}

function AvoidedShare({ avoided }: { avoided: Avoided }) {
  const share = (value: number | null | undefined) => (value === null || value === undefined ? "–" : percent(value));
  return (
    <ul class="summary">
      <li>
        <b>{share(avoided.measured?.value)}</b>
        {two.avoided}, {two.measured}
        {avoided.matching === 0 && `: ${two.noMatch}`}
      </li>
      <li>
        <b>{share(avoided.predicted)}</b>
        {two.avoided}, {two.predicted}
      </li>
      <li>
        <b>{avoided.matching}</b>
        {two.matching(avoided.matching)}
      </li>
    </ul>
  );
}

function Ratios({ result, sides, level }: { result: Result; sides: Sides; level: string }) {
  const title = two.ratioOf(sides[0] ?? "", sides[1] ?? "");
  const show = (v: number) => significant(v, 3);
  return (
    <Figure title={title} note={two.ratioNote(level)}>
      {(width) => (
        <Intervals
          rows={result.joints.map((joint) => ({
            name: joint.name,
            marks: [
              {
                mark: changed(joint.p_value) ? "positive" : "free",
                value: joint.ratio,
                low: joint.ratio_interval?.[0] ?? null,
                high: joint.ratio_interval ? joint.ratio_interval[1] : joint.ratio,
                instead: joint.reason === null ? "–" : text.verdicts.unobservable,
                label: `${joint.name}: ${joint.ratio === null ? "–" : show(joint.ratio)}`,
              },
            ],
          }))}
          width={width}
          label={title}
          unit={two.ratioAxis}
          format={(v) => String(Number(v.toPrecision(2)))}
          reference={1}
        />
      )}
    </Figure>
  );
}

const changed = (p: number | null): boolean => p !== null && p < 0.05;

/** A name that tells an entry from the others. */
function entryName(fit: ComparedRun): string {
  const short = text.methods[fit.method];
  if (fit.weighting !== "characteristic_length") return short;
  return fit.characteristic_length
    ? `${short}, ${words.lengthOf(significant(fit.characteristic_length * 1e3, 2))}`
    : `${short}, ${words.byLength}`;
}

/** Entries of a constraint, one for each method. */
function byMethod(entries: ComparedRun[], positive: boolean): ComparedRun[] {
  const fitting = entries.filter((fit) => fit.positive === positive);
  return [...new Map(fitting.map((fit) => [entryName(fit), fit])).values()];
}

function Methods({ entries, level, side }: { entries: ComparedRun[]; level: string; side: string | null }) {
  const [constraint, setConstraint] = useState<"positive" | "unconstrained">("positive");
  if (entries.length === 0) return null;
  return (
    <StiffnessFigure
      title={side === null ? words.chartTitle : `${words.chartTitle}: ${side}`}
      level={level}
      series={byMethod(entries, constraint === "positive").map((fit, i) => ({
        label: entryName(fit),
        mark: `method-${i}`,
        joints: fit.joints,
      }))}
      tools={
        <Choice
          label={text.run.method}
          value={constraint}
          change={setConstraint}
          options={{ positive: text.options.constrained, unconstrained: text.options.unconstrained }}
        />
      }
    />
  );
}

const inMillimetres = (lengths: (number | null)[]): (number | null)[] =>
  lengths.map((length) => (length === null ? null : length * 1e3));

/** The paper's figure 7: the deflection of each configuration on both sides. */
function Deflections({ result: { sides: compared }, sides }: { result: Result; sides: Sides }) {
  const names = [...new Set(compared.flatMap(({ configurations }) => configurations))];
  const series = compared.map(({ configurations, deflection }, i) => {
    const lengths = new Map(configurations.map((name, c) => [name, deflection[c] ?? null]));
    const values = inMillimetres(names.map((name) => lengths.get(name) ?? null));
    return { mark: i ? "method-0" : "measured", label: sides[i] ?? "", values };
  });
  return <BarFigure unit={text.units.mm} title={words.deflection} note={words.deflectionNote} {...{ names, series }} />;
}

/** The paper's figure 8: what is left of a side's deflection after compensation by each method. */
function Left({ result, at, side }: { result: Result; at: number; side: string | null }) {
  const own = result.sides[at];
  if (!own) return null;
  const fits = result.entries.filter((fit) => fit.side === own.side && fit.left.length > 0);
  const chosen = byMethod(
    fits,
    fits.some((fit) => fit.positive),
  );
  const series = [
    { mark: "measured", label: two.measured, values: inMillimetres(own.deflection) },
    ...chosen.map((fit, i) => ({ mark: `method-${i}`, label: entryName(fit), values: inMillimetres(fit.left) })),
  ];
  const title = side === null ? words.left : words.leftOf(side);
  return (
    <BarFigure unit={text.units.mm} title={title} note={words.leftNote} names={own.configurations} series={series} />
  );
}

function ByConfiguration({ avoided: { configurations } }: { avoided: Avoided }) {
  const names = configurations.map((one) => one.observation);
  const share = (value: number | null | undefined) => (value == null ? null : value * 100);
  const series = [
    { mark: "measured", label: two.measured, values: configurations.map((one) => share(one.measured?.value)) },
    { mark: "predicted", label: two.predicted, values: configurations.map((one) => share(one.predicted)) },
  ];
  const { byConfiguration: title, byConfigurationNote: note } = two;
  return <BarFigure unit={text.units.share} {...{ title, note, names, series }} />;
}
