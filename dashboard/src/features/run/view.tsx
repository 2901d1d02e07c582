/** One run: its result in parts. */
import type { ComponentType, VNode } from "preact";
import { api } from "../../api/calls";
import type { Run } from "../../api/types";
import { NameLink, ActionButton, Tabs, lazy, usePhone } from "../../components/basics";
import { JobPage } from "../../components/job_page";
import { freshKey } from "../../lib/json";
import { useAction, link } from "../../state/action";
import { text } from "../../words";
import { type PartProps, type RunContext, contextOf, elasticityOf } from "../../state/run_context";
import { unusualWays } from "../../lib/ways";
import { chosenIn } from "./chosen";
import { BesideButton, First, StiffnessPart } from "./stiffness";

const DeflectionPart = lazy(async () => (await import("./deflection")).DeflectionPart);
const RunArm = lazy(async () => (await import("./arm")).RunArm);
const RobotPart = lazy(async () => (await import("./deflection")).RobotPart);
const PredictPart = lazy(async () => (await import("../use/forms")).PredictPart);
const MapForm = lazy(async () => (await import("../use/forms")).MapForm);
const CorrectForm = lazy(async () => (await import("../use/forms")).CorrectForm);
const JobList = lazy(async () => (await import("../runs/view")).JobList);
const RunFiles = lazy(async () => (await import("../use/forms")).RunFiles);

export function RunView({ id, part, query }: { id: string; part: string; query: URLSearchParams }) {
  const phone = usePhone(); // a phone shows what to do beneath the joints
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
            {unusual(run) && <span>{unusual(run)}</span>}
            <NameLink to={["robots", robot.id]}>{robot.name}</NameLink>
          </>
        ),
        first: phone ? null : <First run={run} set={set} />,
        actions: (
          <>
            {run.result && <BesideButton run={run} result={run.result} />}
            <Repeat run={run} />
          </>
        ),
      })}
    >
      {(_, context) => <Parts context={context} part={part || "result"} query={query} />}
    </JobPage>
  );
}

const unusual = (run: Run): string => unusualWays({ ...run.request, elasticity: elasticityOf(run), variant_of: null });

function Repeat({ run }: { run: Run }) {
  const repeat = useAction(async () => {
    const again = await api.runs.add(run.request, freshKey("run"));
    return link(["runs", again.id]);
  });
  const recorded = run.provenance.versions.document;
  return (
    <>
      <ActionButton action={repeat}>{text.run.repeat}</ActionButton>
      {recorded && <small>{text.run.recordedBefore(recorded)}</small>}
    </>
  );
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
  (Form: ComponentType<Pick<PartProps, "context">>, collection: "maps" | "corrections") =>
  ({ context }: PartProps): VNode => (
    <>
      <Form context={context} />
      <JobList collection={collection} about={{ robot_id: context.robot.id }} />
    </>
  );

/** A part with the arm beside it; the numbers come first for those who read, and do not wait for the arm. */
const withArm =
  (Part: ComponentType<PartProps>, part: string) =>
  (props: PartProps): VNode => (
    <div class="beside-arm">
      <div class="parts">
        <Part {...props} />
      </div>
      {props.result.residuals.length > 0 && (
        <section class="card run-arm" aria-label={text.run.arm}>
          <RunArm context={props.context} result={props.result} chosen={chosenIn(props.query)} part={part} />
        </section>
      )}
    </div>
  );

const VIEWS: Record<keyof typeof text.run.views, ComponentType<PartProps>> = {
  result: withArm(StiffnessPart, "result"),
  deflection: withArm(DeflectionPart, "deflection"),
  robot: RobotPart,
  predict: PredictPart,
  map: withList(MapForm, "maps"),
  correct: withList(CorrectForm, "corrections"),
  report: RunFiles,
};
