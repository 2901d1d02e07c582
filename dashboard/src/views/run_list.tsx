/** Runs as rows: what, how, when, and how far those that go on have come. */
import { useEffect, useState } from "preact/hooks";
import { follow, goesOn, type Standing } from "../api/events";
import type { RunSummary } from "../api/types";
import { Name, State, When } from "../parts/basics";
import { Bar } from "../parts/going";
import type { Names } from "../state/names";
import { link } from "../state/router";
import { text } from "../text";

/** A browser keeps six connections to a host; those that are followed must leave some for the rest of the page. */
const FOLLOWED = 3;

export function RunList({
  runs,
  names,
  remove,
}: {
  runs: RunSummary[];
  names: Names | null;
  remove?: (run: RunSummary) => void;
}) {
  const followed = new Set(
    runs
      .filter((run) => goesOn(run.state))
      .slice(0, FOLLOWED)
      .map((run) => run.id),
  );
  return (
    <ul class="rows">
      {runs.map((run) => (
        <RunRow key={run.id} run={run} names={names} live={followed.has(run.id)} {...(remove ? { remove } : {})} />
      ))}
    </ul>
  );
}

function RunRow({
  run,
  names,
  live,
  remove,
}: {
  run: RunSummary;
  names: Names | null;
  live: boolean;
  remove?: (run: RunSummary) => void;
}) {
  const standing = useStanding(run, live);
  const set = names?.set(run.measurement_set_id) ?? "…";
  return (
    <li class="item">
      <a class="main" href={link(["runs", run.id])}>
        <span class="what">
          <Name>{set}</Name>
          <small>
            <Name>{names?.robot(run.robot_id) ?? ""}</Name>
          </small>
        </span>
        <span class="how">
          {text.methods[run.method] ?? run.method}
          <small>
            {run.positive ? text.options.constrained : text.options.unconstrained}
            {run.weighting !== "covariance" && `, ${text.weightings[run.weighting] ?? ""}`}
            {run.elasticity !== "joints" && `, ${text.elasticities[run.elasticity]}`}
          </small>
        </span>
        <span class="when">
          <When time={run.created_at} />
        </span>
        <span class="standing">
          <State state={standing.state} />
          {goesOn(standing.state) && <Bar standing={standing} />}
        </span>
      </a>
      {remove && !goesOn(standing.state) && (
        <button
          type="button"
          class="button quiet icon"
          aria-label={text.runs.delete(set)}
          title={text.run.delete}
          onClick={() => remove(run)}
        >
          <svg viewBox="0 0 24 24" aria-hidden="true">
            <path d="M5 7h14M10 7V5h4v2M7 7l1 12h8l1-12M10.5 11v5M13.5 11v5" />
          </svg>
        </button>
      )}
    </li>
  );
}

/** A run's state, live while it goes on and is followed. */
function useStanding(run: RunSummary, live: boolean): Standing {
  const [standing, set] = useState<Standing>({ id: run.id, state: run.state, progress: null });
  useEffect(() => {
    set({ id: run.id, state: run.state, progress: null });
    return live ? follow("runs", run.id, set) : undefined;
  }, [run.id, run.state, live]);
  return standing;
}
