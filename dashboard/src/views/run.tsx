/** One run: its state while it goes on, then its result in four parts. */
import { api, problemOf } from "../api/client";
import { goesOn } from "../api/events";
import { Name, ProblemNote, Show, State, Tabs, Title, When } from "../parts/basics";
import { Cancelled, Going } from "../parts/going";
import { save } from "../parts/download";
import { fileName } from "../pure/csv";
import { freshKey } from "../pure/hash";
import { useAction } from "../state/action";
import { useLoad } from "../state/load";
import { go, link } from "../state/router";
import { toast } from "../state/toasts";
import { text } from "../text";
import { isElastic, type RunContext } from "./run_context";
import { DeflectionPart } from "./run_deflection";
import { EvidencePart } from "./run_evidence";
import { RobotPart } from "./run_robot";
import { StiffnessPart } from "./run_stiffness";

export function RunView({ id, part }: { id: string; part: string }) {
  const loaded = useLoad(
    async (signal): Promise<RunContext> => {
      const run = await api.run(id, signal);
      const set = await api.set(run.request.measurement_set_id, signal);
      return { run, set, robot: await api.robot(set.robot_id, signal) };
    },
    [id],
  );
  return (
    <Show of={loaded} title={text.run.kind}>
      {(context) => (
        <>
          <Head context={context} />
          <Body context={context} part={part} ended={loaded.reload} />
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
  const share = () => {
    if (!navigator.clipboard) return void prompt(text.run.share, location.href); // plain http has no clipboard
    void navigator.clipboard.writeText(location.href).then(() => toast(text.run.shared));
  };
  const remove = useAction(async () => {
    await api.deleteRun(run.id);
    go("#/runs");
    toast(text.runs.deleted(set.name), { label: text.runs.undo, run: () => restore(run.id) });
  });
  return (
    <>
      <div class="head">
        <Title kind={text.run.kind} plain={set.name}>
          <Name>{set.name}</Name>
        </Title>
        <p class="meta">
          {!goesOn(run.state) && <State state={run.state} />}
          <span>
            {text.methods[run.request.method ?? ""]},{" "}
            {run.request.positive === false ? text.options.unconstrained : text.options.constrained}
            {isElastic(run) && `, ${text.elasticities[run.request.elasticity ?? ""] ?? ""}`}
          </span>
          <a href={link(["robots", robot.id])}>
            <Name>{robot.name}</Name>
          </a>
          <When time={run.provenance.created_at} />
        </p>
        <div class="actions">
          <button type="button" class="button" disabled={repeat.busy} onClick={repeat.run}>
            {text.run.repeat}
          </button>
          <button type="button" class="button" onClick={share}>
            {text.run.share}
          </button>
          <button
            type="button"
            class="button"
            title={text.run.downloadHint}
            onClick={() => save(JSON.stringify(run, null, 2), "application/json", fileName(`run-${run.id}`, "json"))}
          >
            {text.run.download}
          </button>
          {!goesOn(run.state) && (
            <button type="button" class="button quiet" disabled={remove.busy} onClick={remove.run}>
              {text.run.delete}
            </button>
          )}
        </div>
      </div>
      {repeat.problem && <ProblemNote problem={repeat.problem} />}
      {remove.problem && <ProblemNote problem={remove.problem} />}
    </>
  );
}

function restore(id: string): void {
  api.restoreRun(id).then(
    () => go(link(["runs", id])),
    (error: unknown) => toast(problemOf(error).detail),
  );
}

function Body({ context, part, ended }: { context: RunContext; part: string; ended: () => void }) {
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
        <DeflectionPart context={context} result={run.result} />
      ) : part === "robot" ? (
        <RobotPart context={context} result={run.result} />
      ) : part === "evidence" ? (
        <EvidencePart context={context} result={run.result} />
      ) : (
        <StiffnessPart context={context} result={run.result} />
      )}
    </>
  );
}
