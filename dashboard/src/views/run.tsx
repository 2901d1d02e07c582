/** One run: its result in parts. */
import type { ComponentType, VNode } from "preact";
import { api } from "../api/calls";
import type { Run } from "../api/types";
import { NameLink, ActionButton, LinkButton, Tabs, lazy } from "../components/basics";
import { JobPage, variantBy } from "../components/job_page";
import { freshKey } from "../lib/json";
import { useAction, link } from "../state/action";
import { text } from "../i18n";
import { type PartProps, type RunContext, contextOf, elasticityOf } from "./run_context";
import { howOf } from "../lib/ways";
import { StiffnessPart } from "./run_stiffness";

const DeflectionPart = lazy(async () => (await import("./run_deflection")).DeflectionPart);
const RobotPart = lazy(async () => (await import("./run_deflection")).RobotPart);
const PredictPart = lazy(async () => (await import("./use")).PredictPart);
const MapForm = lazy(async () => (await import("./use")).MapForm);
const ProgramForm = lazy(async () => (await import("./use")).ProgramForm);
const JobList = lazy(async () => (await import("./runs")).JobList);
const RunFiles = lazy(async () => (await import("./use")).RunFiles);

export function RunView({ id, part, query }: { id: string; part: string; query: URLSearchParams }) {
  return (
    <JobPage
      collection="runs"
      id={id}
      kind={text.run.kind}
      load={async (signal) => {
        const run = await api.runs.one(id, signal);
        return { job: run, ...(await contextOf(run)) };
      }}
      head={({ run, set, robot }) => ({
        name: set.name,
        list: "#/runs",
        about: (
          <>
            {run.request.variant_of && <a href={link(["runs", run.request.variant_of])}>{text.assessment.variantOf}</a>}
            <span>{howOf({ ...run.request, elasticity: elasticityOf(run), variant_of: null })}</span>
            <NameLink to={["robots", robot.id]}>{robot.name}</NameLink>
          </>
        ),
        first: <First run={run} set={set} />,
        actions: <Repeat run={run} />,
      })}
    >
      {(_, context) => <Parts context={context} part={part || "result"} query={query} />}
    </JobPage>
  );
}

/** What to do next, by the verdict: mend what is wrong, measure more, or use the result. */
function First({ run, set }: Pick<RunContext, "run" | "set">) {
  const words = text.run.first;
  const { verdict, reasons } = run.result?.assessment ?? { reasons: [] };
  const offered = reasons.flatMap((reason) => reason.action ?? []).filter(({ kind }) => kind !== "show_posture");
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
      href={verdict === "use" ? link(["runs", run.id, "program"]) : link(["plans"], { set: set.id, run: run.id })}
    >
      {verdict === "use" ? words.use : words.measure}
    </LinkButton>
  );
}

function Repeat({ run }: { run: Run }) {
  const repeat = useAction(async () => {
    const again = await api.runs.add(run.request, freshKey("run"));
    return link(["runs", again.id]);
  });
  return <ActionButton action={repeat}>{text.run.repeat}</ActionButton>;
}

function Parts({ context, part, query }: { context: RunContext; part: string; query: URLSearchParams }) {
  const { run } = context;
  const { result } = run;
  if (!result) return null;
  const tabs = (Object.keys(VIEWS) as (keyof typeof VIEWS)[]).map((id) => ({
    id,
    label: text.run.views[id],
    href: link(id === "result" ? ["runs", run.id] : ["runs", run.id, id]),
  }));
  const View = VIEWS[tabs.find(({ id }) => id === part)?.id ?? "result"];
  return (
    <>
      <Tabs label={text.run.tabs} tabs={tabs} current={part} />
      <View context={context} result={result} query={query} />
    </>
  );
}

/** A form, and what was made by it before of runs of this robot. */
const withList =
  (Form: ComponentType<Pick<PartProps, "context">>, collection: "maps" | "programs") =>
  ({ context }: PartProps): VNode => (
    <>
      <Form context={context} />
      <JobList collection={collection} about={{ robot_id: context.robot.id }} />
    </>
  );

const VIEWS: Record<keyof typeof text.run.views, ComponentType<PartProps>> = {
  result: StiffnessPart,
  deflection: DeflectionPart,
  robot: RobotPart,
  predict: PredictPart,
  map: withList(MapForm, "maps"),
  program: withList(ProgramForm, "programs"),
  report: RunFiles,
};
