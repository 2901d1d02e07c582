/** Runs as rows: what, how, when, and how far those that go on have come. */
import { useEffect, useState } from "preact/hooks";
import { follow, goesOn, type Standing } from "../api/events";
import type { RunSummary } from "../api/types";
import { Name, State, When } from "../parts/basics";
import type { Names } from "../state/names";
import { link } from "../state/router";
import { text } from "../text";

export function RunList({ runs, names, remove }: { runs: RunSummary[]; names: Names | null; remove?: (run: RunSummary) => void }) {
  return (
    <ul class="rows">
      {runs.map((run) => <RunRow key={run.id} run={run} names={names} {...(remove ? { remove } : {})} />)}
    </ul>
  );
}

function RunRow({ run, names, remove }: { run: RunSummary; names: Names | null; remove?: (run: RunSummary) => void }) {
  const standing = useStanding(run);
  const set = names?.set(run.measurement_set_id) ?? "…";
  return (
    <li class="item">
      <a class="main" href={link(["runs", run.id])}>
        <span class="what"><Name>{set}</Name><small><Name>{names?.robot(run.robot_id) ?? ""}</Name></small></span>
        <span class="how">
          {text.methods[run.method] ?? run.method}
          <small>{run.positive ? text.options.constrained : text.options.unconstrained}{run.weighting !== "covariance" && `, ${text.weightings[run.weighting] ?? ""}`}</small>
        </span>
        <span class="when"><When time={run.created_at} /></span>
        <span class="standing"><State state={standing.state} />{goesOn(standing.state) && <Bar standing={standing} />}</span>
      </a>
      {remove && !goesOn(standing.state) && (
        <button type="button" class="button quiet icon" aria-label={text.runs.delete(set)} title={text.run.delete} onClick={() => remove(run)}>
          <svg viewBox="0 0 24 24" aria-hidden="true"><path d="M5 7h14M10 7V5h4v2M7 7l1 12h8l1-12M10.5 11v5M13.5 11v5" /></svg>
        </button>
      )}
    </li>
  );
}

/** The progress of something long. */
export function Bar({ standing }: { standing: Standing }) {
  const { progress } = standing;
  if (!progress || progress.total <= 0) return <progress aria-label={text.run.progress} />;
  const label = text.run.progressOf(progress.done, progress.total, progress.unit);
  return <span class="progress"><progress aria-label={text.run.progress} value={progress.done} max={progress.total} /><small>{label}</small></span>;
}

/** A run's state, live while it goes on. */
function useStanding(run: RunSummary): Standing {
  const [standing, set] = useState<Standing>({ id: run.id, state: run.state, progress: null });
  useEffect(() => {
    set({ id: run.id, state: run.state, progress: null });
    return goesOn(run.state) ? follow("runs", run.id, set) : undefined;
  }, [run.id, run.state]);
  return standing;
}
