/** Comparisons: where they start, methods on one set or two sets with the ratios of their stiffnesses, and runs side by side. */
import { api } from "../../api/calls";
import { ApiError } from "../../api/problem";
import { queries } from "../../api/queries";
import type { ComparedRun, Comparison, MeasurementSetSummary, Run, RunSummary } from "../../api/types";
import { freshKey } from "../../lib/json";
import type { ComponentProps } from "preact";
import { useState } from "preact/hooks";
import { BarFigure, Figure } from "../../charts/figure";
import { Intervals, StiffnessFigure } from "../run/joint_table";
import {
  Choice,
  Download,
  LinkButton,
  Name,
  NameLink,
  ActionButton,
  Empty,
  Head,
  Show,
  Tabs,
  Title,
  Toggle,
} from "../../components/basics";
import { Further } from "../../components/findings";
import { JobLines, JobPage, JobTables, VerdictCard } from "../../components/job_page";
import { estimateText, shownEstimate } from "../../lib/estimate";
import { percent, significant, timeText } from "../../lib/format";
import { unsaid } from "../../lib/said";
import { link, useAction, parse } from "../../state/action";
import { SearchedSelect, SetSelect, useSetChoices } from "../../components/choosers";
import { SETS } from "../../state/choices";
import { ask, useQuery } from "../../state/query";
import { useTypedValue } from "../../state/session";
import { text } from "../../words";
import { howOf } from "../../lib/ways";
import { MOST_RUNS, JobList } from "../runs/view";
import { identified, type RunOptions } from "../run/identified";
import { type RunColumn, RunsTable } from "../run/stiffness";
import { NoSets } from "../robots/view";
import { compareWords, pairWords } from "./words";

/** The paper's methods, and the complete pose with weights of covariance. */
const METHODS = [
  { method: "complete_pose", weighting: "characteristic_length" },
  { method: "complete_pose", weighting: "covariance" },
  { method: "partial_pose", weighting: "covariance" },
  { method: "decoupled_partial_pose", weighting: "covariance" },
] as const;
const PARTIAL = METHODS[2];
const UNCONSTRAINED = { positive: false, stiffness_bounds: {}, stiffness_order: [] };

type Resampling = { size: number; repetitions: number; seed: number };

const optionsOf = (set: string, method: (typeof METHODS)[number], positive: boolean): RunOptions => ({
  measurement_set_id: set,
  elasticity: "joints",
  positive,
  ...method,
});

/** The runs of a set by all methods, unconstrained and constrained; none by methods that it cannot support. */
async function byMethods(set: string, resampling: Resampling | null): Promise<Run[]> {
  const asked = METHODS.flatMap((method) =>
    [false, true].map((positive) => ({
      ...optionsOf(set, method, positive),
      ...(resampling && { resampling: { ...resampling, replacement: false } }),
    })),
  );
  const made = await Promise.all(
    asked.map((options) =>
      identified(options).catch((error: unknown) => {
        if (error instanceof ApiError && error.problem.status === 422) return null;
        throw error;
      }),
    ),
  );
  return made.filter((run) => run !== null);
}

/** A run of joints alone with the options of a run, and the same without constraints where one holds a joint. */
async function comparable(run: Run): Promise<Run[]> {
  const { variant_of: _, ...options } = run.request;
  const joints = { ...options, elasticity: "joints" as const, resampling: null };
  const plain = (run.result?.choice?.elasticity ?? "joints") === "joints" ? run : await identified(joints);
  const held = plain.result?.joints.some((joint) => joint.status === "at_bound") ?? false;
  return held ? [plain, await identified({ ...joints, ...UNCONSTRAINED })] : [plain];
}

interface PairOptions {
  ordered: boolean;
  same_load: boolean;
  same_cell: boolean;
}

const compared = (runs: Run[], options: Partial<PairOptions> = {}): Promise<Comparison> =>
  api.comparisons.add(
    {
      run_ids: [...new Set(runs.map((run) => run.id))],
      ordered: false,
      same_load: false,
      same_cell: false,
      ...options,
    },
    freshKey("comparison"),
  );

/** Compare two sides, `run:…` or `set:…`, which is identified; on request by all methods. */
async function compareSides(sides: string[], options: Partial<PairOptions>, methods: boolean): Promise<Comparison> {
  const runs = await Promise.all(
    sides.map(async (side) => {
      const [kind, id = ""] = side.split(":", 2);
      const own = await (kind === "run" ? api.runs.one(id) : identified(optionsOf(id, PARTIAL, true)));
      const leading = await comparable(own);
      return methods ? [...leading, ...(await byMethods(own.request.measurement_set_id, null))] : leading;
    }),
  );
  return compared(runs.flat(), options);
}

const words = compareWords;
const two = pairWords;
type Result = NonNullable<Comparison["result"]>;

export function ComparisonView({ id }: { id: string }) {
  return (
    <JobPage
      collection="comparisons"
      id={id}
      kind={text.app.compare}
      load={async (signal) => {
        const job = await api.comparisons.one(id, signal);
        const ids = [job.measurement_set_id, ...(job.second_set_id ? [job.second_set_id] : [])];
        const sets = await Promise.all(ids.map((set) => ask(queries.set(set))));
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
            {job.result.sides.length > 1 && <LinkButton href={swapped(job.result)}>{two.swap}</LinkButton>}
          </>
        ),
      })}
    >
      {(result, { job, sides }) => <ComparisonPage id={job.id} {...{ result, sides }} />}
    </JobPage>
  );
}

const swapped = ({ sides: [first, second] }: Result): string =>
  link(["compare", "pairs"], { first: `run:${second?.run_id}`, second: `run:${first?.run_id}` });

function ComparisonPage({ id, result, sides }: { id: string; result: Result; sides: string[] }) {
  const level = percent(result.confidence);
  const { assessment, warnings, entries, avoided } = result;
  const paired = avoided !== null;
  const { mm, share } = text.units;
  return (
    <>
      <VerdictCard assessment={assessment} context={null} />
      <Further warnings={unsaid(warnings, assessment.reasons)} />
      <JobLines collection="comparisons" id={id} />
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
      {sides.map((side, i) => {
        const own = entries.filter((fit) => fit.side === (i ? "second" : "first") && !fit.error);
        return own.length > 2 || !paired ? <Methods entries={own} level={level} side={paired ? side : null} /> : null;
      })}
      {paired && result.avoided?.configurations.some(({ side }) => side === "both") && (
        <BarFigure unit={mm} {...ofDeflections(result, sides)} />
      )}
      {result.sides.map((own, i) => (
        <BarFigure unit={mm} {...ofWhatIsLeft(own, entries, paired ? words.leftOf(sides[i] ?? "") : words.left)} />
      ))}
      {avoided && <BarFigure unit={share} {...ofAvoided(avoided)} />}
    </>
  );
}

function Ratios({ result, sides, level }: { result: Result; sides: string[]; level: string }) {
  const title = two.ratioOf(sides[0] ?? "", sides[1] ?? "");
  return (
    <Figure title={title} note={two.ratioNote(level)}>
      {(width) => (
        <Intervals
          rows={result.joints.map((joint) => ({
            name: joint.name,
            marks: [
              {
                mark: joint.p_value !== null && joint.p_value < 0.05 ? "positive" : "free",
                value: joint.ratio,
                low: joint.ratio_interval?.[0] ?? null,
                high: joint.ratio_interval ? joint.ratio_interval[1] : joint.ratio,
                instead: joint.reason === null ? "–" : text.verdicts.unobservable[0],
                lines: [joint.name, estimateText(shownEstimate(joint.ratio, joint.ratio_interval ?? null))],
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

type Bars = Omit<ComponentProps<typeof BarFigure>, "unit">;

/** The paper's figure 7: the deflection of each configuration that both sides have, in the same posture under the same load. */
function ofDeflections({ sides: compared, avoided }: Result, sides: string[]): Bars {
  const names = (avoided?.configurations ?? []).flatMap(({ observation, side }) =>
    side === "both" ? [observation] : [],
  );
  const series = compared.map(({ configurations, deflection }, i) => {
    const lengths = new Map(configurations.map((name, c) => [name, deflection[c] ?? null]));
    const values = inMillimetres(names.map((name) => lengths.get(name) ?? null));
    return { mark: i ? "method-0" : "measured", label: sides[i] ?? "", values };
  });
  return { title: words.deflection, note: words.deflectionNote, names, series };
}

/** The paper's figure 8: what is left of a side's deflection after compensation by each method. */
function ofWhatIsLeft(own: Result["sides"][number], entries: ComparedRun[], title: string): Bars {
  const fits = entries.filter((fit) => fit.side === own.side && fit.left.length > 0);
  const isHeld = fits.some((fit) => fit.positive);
  const series = [
    { mark: "measured", label: two.measured, values: inMillimetres(own.deflection) },
    ...byMethod(fits, isHeld).map((fit, i) => ({
      mark: `method-${i}`,
      label: entryName(fit),
      values: inMillimetres(fit.left),
    })),
  ];
  return { title, note: words.leftNote, names: own.configurations, series };
}

function ofAvoided({ configurations }: NonNullable<Result["avoided"]>): Bars {
  const share = (value: number | null | undefined) => (value == null ? null : value * 100);
  const series = [
    { mark: "measured", label: two.measured, values: configurations.map((one) => share(one.measured?.value)) },
    { mark: "predicted", label: two.predicted, values: configurations.map((one) => share(one.predicted)) },
  ];
  const names = configurations.map((one) => one.observation);
  return { title: two.byConfiguration, note: two.byConfigurationNote, names, series };
}

const sideBySideWords = text.lists;
export function SideBySideView({ ids }: { ids: string[] }) {
  const pair = useAction(async () => {
    const sides = ids.map((id) => `run:${id}`);
    const made = await compareSides(sides, {}, false);
    return link(["compare", "methods", made.id]);
  });
  const loaded = useQuery({
    queryKey: ["beside", ids],
    queryFn: async () => {
      const runs = await Promise.all(ids.slice(0, MOST_RUNS).map((id) => ask(queries.run(id))));
      const sets = await Promise.all(runs.map((run) => ask(queries.set(run.request.measurement_set_id))));
      return runs.map((run, i): RunColumn => ({ run, name: sets[i]?.name ?? run.id, note: howOf(run.request) }));
    },
  });
  return (
    <Show
      of={loaded}
      title={text.app.compare}
      instead={({ length }) => length < 2 && <Empty title={text.app.compare} hint={sideBySideWords.selectTwo} />}
    >
      {(columns) => {
        const title = columns.map((column) => column.name).join(" · ");
        return (
          <>
            <Head
              kind={text.app.compare}
              plain={title}
              title={sideBySideWords.sideBySide(columns.length)}
              first={columns.length === 2 && <ActionButton action={pair}>{sideBySideWords.test}</ActionButton>}
            />
            <section class="card">
              <RunsTable columns={columns} label={title} />
            </section>
            <StiffnessFigure
              title={text.run.stiffness}
              level={percent(columns[0]?.run.request.confidence ?? 0.95)}
              series={columns.map(({ run, name, note }, i) => ({
                label: `${name}: ${note}`,
                mark: `method-${i}`,
                joints: run.result?.joints ?? [],
              }))}
            />
          </>
        );
      }}
    </Show>
  );
}

const KINDS = ["methods", "pairs"] as const;

export function CompareView({ kind }: { kind: string }) {
  const sets = useQuery(queries.sets(SETS));
  return (
    <>
      <Title plain={text.app.compare}>{text.app.compare}</Title>
      <Tabs
        label={words.tabs}
        current={kind}
        tabs={KINDS.map((id) => ({ id, label: words[id], href: link(["compare", id]) }))}
      />
      <Show of={sets} instead={({ items }) => items.length === 0 && <NoSets />}>
        {({ items }) => (
          <>
            {kind === "pairs" ? <StartPair newest={items} /> : <StartMethods newest={items} />}
            <JobList collection="comparisons" />
          </>
        )}
      </Show>
    </>
  );
}

function StartMethods({ newest }: { newest: MeasurementSetSummary[] }) {
  const given = parse(location.hash).query.get("set") ?? "";
  const [set, setSet] = useTypedValue(`methods/${given}`, given || (newest[0]?.id ?? ""));
  const [resample, setResample] = useTypedValue(`methods/${given}/resample`, false);
  const start = useAction(async () => {
    const count = resample ? (await ask(queries.set(set))).observations.length : 0;
    const resampling = resample ? { size: Math.max(1, Math.round(count / 2)), repetitions: 200, seed: 1 } : null;
    const comparison = await compared(await byMethods(set, resampling));
    return link(["compare", "methods", comparison.id]);
  });
  return (
    <section class="card form">
      <p>{words.methodsIntro}</p>
      <SetSelect label={text.sets.kind} value={set} change={setSet} />
      <Toggle label={words.resample} checked={resample} change={setResample} />
      <ActionButton look="primary" action={start} disabled={!set} going={words.going}>
        {text.app.compare}
      </ActionButton>
    </section>
  );
}

interface SideProps {
  label: string;
  help: string;
  value: string;
  change: (side: string) => void;
  runs: RunSummary[];
}

/** A side of a comparison: a set, which is identified, or a run. */
function Side({ runs, ...field }: SideProps) {
  const { options, search, known } = useSetChoices(
    field.value.startsWith("set:") ? field.value.slice("set:".length) : "",
  );
  const ofRuns = runs.map((run) => ({
    value: `run:${run.id}`,
    label: words.runSide(run.measurement_set_name ?? "…", howOf(run), timeText(run.created_at)),
  }));
  const ofSets = options.map(({ value, label }) => ({ value: `set:${value}`, label }));
  return <SearchedSelect {...field} search={search} known={known} options={[...ofSets, ...ofRuns]} />;
}

function StartPair({ newest: sets }: { newest: MeasurementSetSummary[] }) {
  const runs = useQuery(queries.runs({ elasticity: "joints", state: "succeeded", limit: 100 })).data?.items ?? [];
  const newest = sets[0];
  const others = sets.filter((set) => set.id !== newest?.id && set.robot_id === newest?.robot_id);
  const unlike = others.find((set) => set.encoders !== newest?.encoders);
  const other = unlike ?? others[0] ?? sets[1];
  const [begin, end] = unlike?.encoders === "secondary" ? [newest, unlike] : [other, newest];
  const query = parse(location.hash).query;
  const form = `pair/${query.get("first") ?? ""}/${query.get("second") ?? ""}`;
  const [sides, setSides] = useTypedValue(form, [
    query.get("first") ?? `set:${begin?.id ?? ""}`,
    query.get("second") ?? `set:${end?.id ?? ""}`,
  ]);
  const isOrdered = unlike !== undefined && !query.has("first") && !query.has("second");
  const [ordered, setOrdered] = useTypedValue(`${form}/ordered`, isOrdered);
  const [methods, setMethods] = useTypedValue(`${form}/methods`, false);
  const [sameLoad, setSameLoad] = useTypedValue(`${form}/same_load`, false);
  const [sameCell, setSameCell] = useTypedValue(`${form}/same_cell`, false);
  const start = useAction(async () => {
    const pair = await compareSides(sides, { ordered, same_load: sameLoad, same_cell: sameCell }, methods);
    return link(["compare", "methods", pair.id]);
  }, "pair");
  const possible = sides.every((side) => !side.endsWith(":")) && sides[0] !== sides[1];
  return (
    <section class="card form">
      <p>{words.pairsIntro}</p>
      <div class="row">
        {(["first", "second"] as const).map((name, i) => (
          <Side
            label={words[name]}
            help={words.hints[name]}
            value={sides[i] ?? ""}
            change={(chosen) => {
              setSides(sides.with(i, chosen));
              setOrdered(false);
            }}
            runs={runs}
          />
        ))}
      </div>
      <Toggle label={words.ordered} checked={ordered} change={setOrdered} />
      <Toggle label={words.sameLoad} checked={sameLoad} change={setSameLoad} />
      <Toggle label={words.sameCell} checked={sameCell} change={setSameCell} />
      <Toggle label={words.allMethods} checked={methods} change={setMethods} />
      {!possible && <p class="soft">{words.twoSets}</p>}
      <ActionButton look="primary" action={start} disabled={!possible} going={words.going}>
        {text.app.compare}
      </ActionButton>
    </section>
  );
}
