/** One run: its state while it goes on, then its result in four parts. */
import { api } from "../api/client";
import { goesOn } from "../api/events";
import { Badge } from "../components/badge";
import { Name, ProblemNote, Show, State, Tabs, Title, When } from "../components/basics";
import { Cancelled, Going } from "../components/going";
import { JobActions } from "../components/job_actions";
import { freshKey } from "../lib/hash";
import { useAction } from "../state/action";
import { useLoad } from "../state/load";
import { storedRobot, storedSet } from "../state/stored";
import { go, link } from "../state/router";
import { text } from "../i18n";
import { isElastic, type RunContext } from "./run_context";
import { DeflectionPart } from "./run_deflection";
import { EvidencePart } from "./run_evidence";
import { MapForm } from "./map_form";
import { ProgramForm } from "./program_form";
import { ProgramList } from "./program_list";
import { RobotPart } from "./run_robot";
import { StiffnessPart } from "./run_stiffness";

export function RunView({ id, part, query }: { id: string; part: string; query: URLSearchParams }) {
  const loaded = useLoad(
    async (signal): Promise<RunContext> => {
      const run = await api.run(id, signal);
      const set = await storedSet(run.request.measurement_set_id);
      return { run, set, robot: await storedRobot(set.robot_id) };
    },
    [id],
  );
  return (
    <Show of={loaded} title={text.run.kind}>
      {(context) => (
        <>
          <Head context={context} />
          <Body context={context} part={part} query={query} ended={loaded.reload} />
        </>
      )}
    </Show>
  );
}

function Head({ context: { run, set, robot } }: { context: RunContext }) {
  const repeat = useAction(async () => {
    const again = await api.addRun(run.request, freshKey("run"));
    go(link(["runs", again.id]));
  });
  return (
    <>
      <div class="head">
        <Title kind={text.run.kind} plain={set.name}>
          <Name>{set.name}</Name>
        </Title>
        <p class="meta">
          {run.result ? (
            <Badge verdict={run.result.assessment.verdict} />
          ) : (
            !goesOn(run.state) && <State state={run.state} />
          )}
          {run.request.variant_of !== null && (
            <a href={link(["runs", run.request.variant_of])}>{text.assessment.variantOf}</a>
          )}
          <span>
            {text.methods[run.request.method]},{" "}
            {run.request.positive === false ? text.options.unconstrained : text.options.constrained}
            {isElastic(run) && `, ${text.elasticities[run.request.elasticity]}`}
          </span>
          <a href={link(["robots", robot.id])}>
            <Name>{robot.name}</Name>
          </a>
          <When time={run.provenance.created_at} />
        </p>
        <JobActions
          kind="run"
          job={run}
          name={set.name}
          remove={goesOn(run.state) ? null : () => api.deleteRun(run.id)}
          restore={() => api.restoreRun(run.id)}
          list="#/runs"
        >
          <button type="button" class="button" disabled={repeat.busy} onClick={repeat.run}>
            {text.run.repeat}
          </button>
        </JobActions>
      </div>
      {repeat.problem && <ProblemNote problem={repeat.problem} />}
    </>
  );
}

function Body({
  context,
  part,
  query,
  ended,
}: {
  context: RunContext;
  part: string;
  query: URLSearchParams;
  ended: () => void;
}) {
  const { run } = context;
  if (goesOn(run.state))
    return <Going collection="runs" job={run} cancel={() => api.cancelRun(run.id)} ended={ended} />;
  if (run.state === "cancelled") return <Cancelled progress={run.progress} />;
  if (run.error)
    return (
      <>
        <h2>{text.run.failed}</h2>
        <ProblemNote problem={run.error} />
      </>
    );
  if (!run.result) return null;
  const views = text.run.views;
  const tabs = (Object.keys(views) as (keyof typeof views)[]).map((id) => ({
    id,
    label: views[id],
    href: link(id === "result" ? ["runs", run.id] : ["runs", run.id, id]),
  }));
  return (
    <>
      <Tabs label={text.run.tabs} tabs={tabs} current={part} />
      {part === "deflection" ? (
        <DeflectionPart context={context} result={run.result} at={query.get("at")} />
      ) : part === "robot" ? (
        <RobotPart context={context} result={run.result} query={query} />
      ) : part === "map" ? (
        <MapForm context={context} />
      ) : part === "program" ? (
        <>
          <ProgramForm context={context} />
          <ProgramList robot={context.set.robot_id} />
        </>
      ) : part === "evidence" ? (
        <EvidencePart context={context} result={run.result} />
      ) : (
        <StiffnessPart context={context} result={run.result} />
      )}
    </>
  );
}
