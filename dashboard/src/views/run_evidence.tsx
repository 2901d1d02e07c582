/** Why the numbers can be trusted: identifiability, advice, certificate, goodness of fit, provenance. */
import type { Budget, JointResult, RunResult } from "../api/types";
import { DataTable } from "../components/table";
import { fixed, pValue, percent, significant } from "../lib/format";
import { text } from "../i18n";
import { entriesOf } from "../lib/json";
import { NameLink, Facts, Name, When } from "../components/basics";
import { Term } from "../components/term";
import { type RunContext, isElastic } from "./run_context";

const words = text.evidence;

export function Evidence({ context, result }: { context: RunContext; result: RunResult }) {
  const elastic = isElastic(context.run); // what is said of identifiability is then of the joints alone
  return (
    <details class="card">
      <summary>
        <h2>{words.title}</h2>
      </summary>
      <div class="evidence">
        <Identifiable result={result} elastic={elastic} />
        <Goodness result={result} />
        <Certificate result={result} />
        {result.robust && result.robust.suspicious.length > 0 && <Suspicious result={result} />}
        {result.causes.length > 0 && <Causes causes={result.causes} />}
        {result.weight && <WeightTable weight={result.weight} />}
        {result.budget && <BudgetTable budget={result.budget} joints={result.joints} />}
        <Provenance context={context} />
      </div>
    </details>
  );
}

function Identifiable({ result: { identifiability: found }, elastic }: { result: RunResult; elastic: boolean }) {
  return (
    <section>
      <h3>{words.identifiability}</h3>
      {elastic && <p class="soft">{words.jointsAlone}</p>}
      <Facts
        facts={[
          {
            label: <Term of="rank">{words.rank}</Term>,
            value: <b class="figure-value">{words.rankOf(found.rank, found.parameters)}</b>,
          },
          {
            label: <Term of="condition">{words.condition}</Term>,
            value: (
              <b class="figure-value">
                {found.condition_number === null ? words.conditionNone : significant(found.condition_number, 3)}
              </b>
            ),
          },
          ...found.combinations.map((group) => ({
            label: words.combinations,
            value: <Name>{group.join(" + ")}</Name>,
          })),
        ]}
      />
      {!elastic && found.weakest.map((sentence) => <p class="note warn">{sentence}</p>)}
      <Singular found={found} elastic={elastic} />
    </section>
  );
}

/** How much each direction of the compliances is seen, in numbers that few need. */
function Singular({ found, elastic }: { found: RunResult["identifiability"]; elastic: boolean }) {
  const indices = elastic || !found.observability ? [] : entriesOf(found.observability);
  const several = found.stages.length > 1;
  const names = [words.stages.arm, words.stages.wrist];
  const values = found.stages.flatMap((stage, s) =>
    stage.singular_values.map((value, i) => [
      several ? `${names[s] ?? words.stage(s + 1)} ${i + 1}` : `s${i + 1}`,
      value,
    ]),
  );
  return (
    <>
      {indices.length > 0 && (
        <>
          <p class="soft">{words.observabilityNote}</p>
          <Facts
            facts={indices.map(([name, value]) => ({
              label: <Term of={name}>{words.indices[name]}</Term>,
              value: significant(value, 2),
            }))}
          />
        </>
      )}
      <p class="soft">{words.singularNote}</p>
      <DataTable caption={words.singular} table={{ columns: [words.singular, words.singularSize], rows: values }} />
    </>
  );
}

function Goodness({ result }: { result: RunResult }) {
  const { goodness, complementary_stiffness: complementary } = result;
  return (
    <section>
      <h3>{words.goodness}</h3>
      <Facts
        facts={[
          // with sigma from the residuals it equals the degrees of freedom, whatever was read
          ...(goodness.sigma_source === "given"
            ? [{ label: <Term of="chiSquare">{words.chiSquare}</Term>, value: significant(goodness.chi_square, 4) }]
            : []),
          { label: <Term of="freedom">{words.freedom}</Term>, value: significant(goodness.degrees_of_freedom, 4) },
          ...(goodness.test
            ? [{ label: <Term of="pValue">{words.pValue}</Term>, value: pValue(goodness.test.p_value) }]
            : []),
          {
            label: <Term of="sigma">{words.sigma}</Term>,
            value:
              result.sigma === null
                ? "–"
                : `${significant(result.sigma * 1e6, 3)} ${text.units.micrometre}, ${goodness.sigma_source === "given" ? words.sigmaGiven : words.sigmaResiduals}`,
          },
          ...(complementary
            ? [{ label: words.complementary, value: words.complementaryNote(percent(complementary.largest_ratio)) }]
            : []),
        ]}
      />
    </section>
  );
}

function Certificate({ result: { certificate } }: { result: RunResult }) {
  const small = (value: number) => (value === 0 ? "0" : significant(value, 2));
  return (
    <section>
      <h3>{words.certificate}</h3>
      <p class="soft">{words.certificateNote}</p>
      <Facts
        facts={[
          { label: words.primal, value: small(certificate.primal) },
          { label: words.dual, value: small(certificate.dual) },
          { label: words.complementarity, value: small(certificate.complementarity) },
          {
            label: words.solvedBy,
            value: certificate.solved_by.map((solver) => words.solvers[solver]).join(", "),
          },
        ]}
      />
    </section>
  );
}

function Suspicious({ result }: { result: RunResult }) {
  return (
    <section class="wide">
      <h3>{words.suspicious}</h3>
      <DataTable
        caption={words.suspicious}
        table={{
          columns: [
            text.deflection.configuration,
            text.deflection.target,
            { title: words.weight, show: (v) => fixed(v, 2) },
            { title: words.norm, show: (v) => fixed(v, 1) },
          ],
          rows: (result.robust?.suspicious ?? []).map((s) => [s.observation, s.target, s.weight, s.residual_norm]),
        }}
      />
    </section>
  );
}

function Causes({ causes }: { causes: RunResult["causes"] }) {
  return (
    <section class="wide">
      <h3>{words.causes}</h3>
      <DataTable
        caption={words.causes}
        table={{
          columns: [words.cause, words.first, { title: words.pValue, show: (v) => v.toPrecision(1) }],
          rows: causes.map((cause) => [words.causeName(cause.name), cause.first ?? "", cause.p_value]),
        }}
      />
    </section>
  );
}

function Provenance({ context: { run, set } }: { context: RunContext }) {
  const { provenance } = run;
  const took =
    provenance.started_at && provenance.ended_at
      ? (Date.parse(provenance.ended_at) - Date.parse(provenance.started_at)) / 1e3
      : null;
  return (
    <section class="wide">
      <h3>{words.provenance}</h3>
      <Facts
        wide
        facts={[
          {
            label: text.sets.kind,
            value: <NameLink to={["sets", set.id]}>{set.name}</NameLink>,
          },
          { label: words.created, value: <When time={provenance.created_at} /> },
          ...(took === null ? [] : [{ label: words.took, value: `${significant(took, 2)} s` }]),
          { label: words.identifier, value: <code>{run.id}</code> },
          { label: words.input, value: <code>{provenance.input_hash}</code> },
          {
            label: words.versions,
            value: Object.entries(provenance.versions)
              .map(([name, version]) => `${name} ${version}`)
              .join(", "),
          },
        ]}
      />
      <details>
        <summary>{words.request}</summary>
        <pre tabIndex={0}>{JSON.stringify(run.request, null, 2)}</pre>
      </details>
    </section>
  );
}

const budgetWords = text.budget;
const shown = (value: number) => significant(value, 2);

/** The uncertainty budget: what each joint's uncertainty consists of, relative to its compliance. */
/** Causes of the intervals of a run by own weight. */
function WeightTable({ weight }: { weight: NonNullable<RunResult["weight"]> }) {
  const share = { unit: "%", show: (value: number) => fixed(100 * value, 0) };
  return (
    <section class="wide">
      <h3>{words.ownWeight}</h3>
      <p class="soft">{words.ownWeightNote}</p>
      <DataTable
        caption={words.ownWeight}
        table={{
          columns: [
            text.run.joint,
            { title: words.byReadings, ...share },
            { title: words.byMasses, ...share },
            { title: words.sag, unit: "mrad", show: (value) => fixed(1e3 * value, 2) },
          ],
          rows: weight.joints.map((each) => [each.joint, each.readings, each.masses, each.largest_sag]),
        }}
      />
    </section>
  );
}

function BudgetTable({ budget, joints }: { budget: Budget; joints: JointResult[] }) {
  const sizes = budget.joints.map((name) => joints.find((joint) => joint.name === name)?.compliance ?? null);
  /** In per cent of the compliance, which is that of the stiffness, too. */
  const relative = (values: number[]) =>
    values.map((value, j) => (sizes[j] ? (100 * value) / Math.abs(sizes[j]) : null));
  return (
    <section class="wide">
      <h3>{budgetWords.title}</h3>
      <p class="soft">{budgetWords.note}</p>
      <DataTable
        caption={budgetWords.title}
        table={{
          columns: [
            budgetWords.source,
            budgetWords.type,
            budgetWords.included,
            ...budget.joints.map((name) => ({ title: name, unit: "%", show: shown })),
          ],
          rows: [
            ...budget.components.map((part) => [
              (budgetWords.sources as Record<string, string>)[part.source] ?? part.source,
              part.evaluation,
              part.included ? budgetWords.yes : budgetWords.no,
              ...relative(part.contributions),
            ]),
            [budgetWords.combined, null, null, ...relative(budget.standard_uncertainty)],
            [
              budgetWords.expanded(significant(budget.coverage_factor, 3), budget.probability),
              null,
              null,
              ...relative(budget.expanded_uncertainty),
            ],
            [budgetWords.expandedAll(budget.missing), null, null, ...relative(budget.expanded_with_model_error)],
          ],
        }}
      />
      <h3>{budgetWords.correlation}</h3>
      <p class="soft">{budgetWords.correlationNote}</p>
      <DataTable
        caption={budgetWords.correlation}
        table={{
          columns: [text.run.joint, ...budget.joints.map((name) => ({ title: name, show: shown }))],
          rows: budget.correlation.map((row, j) => [budget.joints[j] ?? "", ...row]),
        }}
      />
    </section>
  );
}
