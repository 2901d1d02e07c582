/** The first tab of a result: whether it may be used, what it comes to, each joint, and why the numbers can be trusted. */
import { api } from "../../api/calls";
import type { AdvisedAction, Run, RunResult } from "../../api/types";
import {
  Badge,
  NameLink,
  Name,
  Facts,
  When,
  Term,
  ActionButton,
  Download,
  LinkButton,
  lazy,
  Prose,
  usePhone,
} from "../../components/basics";
import { type Cell, DataTable, type Table } from "../../components/table";
import { percent, significant } from "../../lib/format";
import { STIFFNESS_UNITS } from "../../lib/stiffness";
import { useSettings } from "../../state/session";
import { text } from "../../words";
import { JobLines, JobTables, questionsOf, Reasons, variantBy, VerdictLine } from "../../components/job_page";
import type { ComponentChildren } from "preact";
import { useState } from "preact/hooks";
import { type PartProps, type RunContext, isElastic } from "../../state/run_context";
import { howOf } from "../../lib/ways";
import { queries } from "../../api/queries";
import { useQuery } from "../../state/query";
import { isUnseen, onPage, unsaid } from "../../lib/said";
import { link, useAction } from "../../state/action";
import { identified } from "./identified";
import { JointTable, Stiffness } from "./joint_table";
import { Further } from "../../components/findings";
import { evidenceWords } from "./words";

const assessmentWords = text.assessment;
const Assumed = lazy(async () => (await import("./assumed")).Assumed);

/** What a joint is if it has a number. */
const NUMBERED = ["identified", "uncertain"];

export interface RunColumn {
  run: Run;
  name: string;
  /** What else tells it from the others. */
  note?: string;
}

/** Runs beside each other: verdict, what they explain, and each joint that any of them has. */
export function RunsTable({ columns, label }: { columns: RunColumn[]; label: string }) {
  const { unit } = useSettings();
  const results = columns.map(({ run }) => run.result);
  const row = (title: string, cell: (result: RunResult) => Cell): Cell[] => [
    title,
    ...results.map((result) => result && cell(result)),
  ];
  const stiffness = (name: string) => (result: RunResult) => {
    const joint = result.joints.find((one) => one.name === name);
    return joint ? <Stiffness joint={joint} /> : "–";
  };
  const levels = new Set(columns.map(({ run }) => percent(run.request.confidence)));
  const names = new Set(results.flatMap((result) => result?.joints.map(({ name }) => name) ?? []));
  const table: Table = {
    columns: ["", ...columns.map(({ run, name, note }) => ({ title: name, to: ["runs", run.id], note }))],
    rows: [
      row(text.run.verdict, ({ assessment }) => <Badge verdict={assessment.verdict} />),
      row(text.lists.explainedTitle, ({ compensation }) => compensation && percent(compensation)),
      row(`${text.lists.rms} [${text.units.micrometre}]`, (result) => significant(result.rms_residual * 1e6, 2)),
      ...[...names].map((name) => row(name, stiffness(name))),
    ],
  };
  return (
    <>
      <div class="side-by-side">
        <DataTable table={table} caption={label} />
      </div>
      <p class="soft">
        {text.run.stiffnessIn(STIFFNESS_UNITS[unit].label)} {text.run.inBrackets([...levels].join(" / "))}
      </p>
    </>
  );
}

const words = evidenceWords;
const EXACT = 1e-9; // m: less is rounding of a fit with as many parameters as readings
const small = (value: number): string => (value === 0 ? "0" : significant(value, 2));

interface EvidenceProps {
  context: RunContext;
  result: RunResult;
  /** Whether a joint has a number. */
  numbered: boolean;
}

export function Evidence({ context: { run, set }, result, numbered }: EvidenceProps) {
  const [open, setOpen] = useState(false);
  const elastic = isElastic(run); // what is said of identifiability is then of the joints alone
  const { identifiability: found, certificate } = result;
  const { provenance } = run;
  return (
    <details class="card evidence" onToggle={(event) => setOpen(event.currentTarget.open)}>
      <summary>
        <h2>{words.title}</h2>
      </summary>
      {numbered && <Summary result={result} />}
      {elastic && <p class="soft">{words.jointsAlone}</p>}
      <Facts
        facts={[
          { label: <Term of="rank">{words.rank}</Term>, value: words.rankOf(found.rank, found.parameters) },
          ...found.combinations.map((group) => ({
            label: words.combinations,
            value: <Name>{group.join(" + ")}</Name>,
          })),
          {
            label: <Term of="certificate">{words.certificate}</Term>,
            value: [certificate.primal, certificate.dual, certificate.complementarity].map(small).join(", "),
          },
          { label: words.solvedBy, value: certificate.solved_by.map((solver) => words.solvers[solver]).join(", ") },
        ]}
      />
      {open && <JobLines collection="runs" id={run.id} of="evidence" />}
      <h3>{words.provenance}</h3>
      <Facts
        wide
        facts={[
          { label: text.sets.kind, value: <NameLink to={["sets", set.id]}>{set.name}</NameLink> },
          { label: words.created, value: <When time={provenance.created_at} /> },
          {
            label: words.versions,
            value: Object.entries(provenance.versions)
              .map((version) => version.join(" "))
              .join(", "),
          },
        ]}
      />
      <details>
        <summary>{words.request}</summary>
        <pre tabIndex={0}>{JSON.stringify(run.request, null, 2)}</pre>
      </details>
    </details>
  );
}

export function StiffnessPart({ context, result, query }: PartProps) {
  const { run } = context;
  const nothing = result.joints.every(({ status }) => !NUMBERED.includes(status));
  const { assessment } = result;
  const phone = usePhone();
  const toDo = [...assessment.reasons, ...questionsOf(assessment)];
  return (
    <>
      <section class={`verdict-card ${assessment.verdict}`} aria-label={assessmentWords.title}>
        <VerdictLine assessment={assessment} />
      </section>
      <JointTable context={context} result={result} bare={nothing} chosen={query.get("joint")} />
      <Caveats context={context} notes={assessment.notes} />
      {phone && (
        <div class="go">
          <First run={run} set={context.set} />
        </div>
      )}
      {toDo.length > 0 && (
        <section class={`verdict-card ${assessment.verdict}`} aria-label={assessmentWords.toDo}>
          <h2>{assessmentWords.toDo}</h2>
          <Reasons assessment={{ ...assessment, reasons: toDo }} context={context} brief />
        </section>
      )}
      {run.request.variant_of && <BeforeAfter run={run} origin={run.request.variant_of} />}
      {(result.links || result.choice?.models.length || result.resampling) && <Model run={run.id} />}
      <Further warnings={unsaid(result.warnings, result.assessment.reasons)} />
      <Evidence context={context} result={result} numbered={!nothing} />
    </>
  );
}

/** The parts of the model besides the joints, and what else was tried: behind the result. */
function Model({ run }: { run: string }) {
  const [open, setOpen] = useState(false);
  return (
    <details class="card evidence" onToggle={(event) => setOpen(event.currentTarget.open)}>
      <summary>
        <h2>{words.model}</h2>
      </summary>
      {open && <JobTables collection="runs" id={run} from={1} />}
    </details>
  );
}

/** What to do next, and the report. */
export const First = ({ run, set }: Pick<RunContext, "run" | "set">) =>
  run.result && (
    <>
      <Next run={run} set={set} />
      <Download href={api.jobs.file(run.id, "report.pdf")}>{text.run.pdf}</Download>
    </>
  );

/** Actions that need a look or a number: they are offered with their reason only. */
const ON_ITS_CARD: readonly AdvisedAction["kind"][] = ["show_posture", "state_payload"];

/** What to do next, by the verdict: mend what is wrong, measure more, or use the result. */
function Next({ run, set }: Pick<RunContext, "run" | "set">) {
  const words = text.run.first;
  const { verdict, reasons } = run.result?.assessment ?? { reasons: [] };
  const offered = reasons.flatMap((reason) => reason.action ?? []).filter(({ kind }) => !ON_ITS_CARD.includes(kind));
  const [action] = offered;
  const several = offered.filter(({ kind }) => kind === action?.kind).length > 1;
  const mend = useAction(async () => {
    return action && link(["runs", (await variantBy(run, action)).id]);
  });
  if (!verdict) return null;
  if (action && verdict !== "use")
    return (
      <ActionButton look="primary" action={mend} going={text.start.going}>
        {several || action.kind === "choose_robot" ? text.assessment.actions[action.kind](action) : words.mend}
      </ActionButton>
    );
  return (
    <LinkButton
      look="primary"
      href={verdict === "use" ? link(["runs", run.id, "correct"]) : link(["plans"], { set: set.id, run: run.id })}
    >
      {verdict === "use" ? words.use : words.measure}
    </LinkButton>
  );
}

/** A line each of what was assumed and of what these readings cannot show; whoever knows better states it behind the line. */
function Caveats({ context, notes }: { context: RunContext; notes: string[] }) {
  const [unseen, assumed] = [notes.filter(isUnseen), notes.filter((note) => !isUnseen(note))];
  if (notes.length === 0) return null;
  return (
    <section class="card caveats" aria-label={assessmentWords.caveats}>
      {assumed.length > 0 && (
        <Caveat title={assessmentWords.assumptions(assumed.length)} notes={assumed}>
          <Assumed context={context} />
        </Caveat>
      )}
      {unseen.length > 0 && <Caveat title={assessmentWords.unseen} notes={unseen} />}
    </section>
  );
}

function Caveat({ title, notes, children }: { title: string; notes: string[]; children?: ComponentChildren }) {
  const [open, setOpen] = useState(false);
  return (
    <details onToggle={(event) => setOpen(event.currentTarget.open)}>
      <summary>{title}</summary>
      <ul class="lines">
        {notes.map((note) => (
          <li>
            <Prose text={onPage(note)} />
          </li>
        ))}
      </ul>
      {open && children}
    </details>
  );
}

/** The same readings, with constraints or without, next to these. */
export function BesideButton({ run, result }: { run: Run; result: RunResult }) {
  const beside = useAction(async () => {
    const { variant_of: _, ...options } = run.request;
    const other = await identified({ ...options, positive: !options.positive, resampling: null });
    return link(["compare", "runs"], { ids: `${run.id},${other.id}` });
  });
  if (isElastic(run) || result.joints.every(({ status }) => !NUMBERED.includes(status))) return null;
  return (
    <ActionButton action={beside} going={text.start.going}>
      {text.run.beside(!run.request.positive)}
    </ActionButton>
  );
}

function Summary({ result }: { result: RunResult }) {
  const words = text.run.summary;
  const { goodness } = result;
  const verdict = goodness.sigma_source === "residuals" ? undefined : goodness.test;
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
      {result.compensation !== null && figure(percent(result.compensation), "", words.compensation)}
      {figure(
        result.rms_residual < EXACT ? "< 0.001" : significant(result.rms_residual * 1e6, 2),
        text.units.micrometre,
        words.rms,
      )}
      {figure(
        result.sigma === null ? "–" : significant(result.sigma * 1e6, 2),
        `${text.units.micrometre} σ`,
        words.noise[verdict ?? "estimated"],
      )}
      {goodness.repeatability_at_targets != null &&
        goodness.repeatability != null &&
        figure(
          significant(goodness.repeatability_at_targets * 1e6, 2),
          text.units.micrometre,
          words.repeatability(significant(goodness.repeatability * 1e6, 2), goodness.repeatability_source === "given"),
        )}
    </ul>
  );
}

/** A run beside the one that it tries to improve: what was changed, and what came of it. */
function BeforeAfter({ run, origin }: { run: Run; origin: string }) {
  const { data: before } = useQuery(queries.run(origin));
  if (!before?.result || !run.result) return null;
  const columns = [
    { run: before, name: assessmentWords.before, note: howOf(before.request) },
    { run, name: assessmentWords.after, note: howOf(run.request) },
  ];
  const corrected = before.request.measurement_set_id !== run.request.measurement_set_id;
  return (
    <section class="card before-after">
      <h2>
        {assessmentWords.beforeAfter} {corrected && <small class="soft">{assessmentWords.corrected}</small>}
      </h2>
      <RunsTable columns={columns} label={assessmentWords.beforeAfter} />
    </section>
  );
}
