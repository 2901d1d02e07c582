/** Runs as rows: what, how, what came of it, and whether it may be used; variants beneath the run they vary. */
import { useEffect, useState } from "preact/hooks";
import { follow, goesOn, type Standing } from "../api/events";
import type { RunSummary } from "../api/types";
import { Badge } from "../components/badge";
import { Button, Name, State, When } from "../components/basics";
import { Bar } from "../components/going";
import { percent } from "../lib/format";
import type { Names } from "../state/names";
import { link } from "../state/router";
import { text } from "../i18n";

/** A browser keeps six connections to a host; those that are followed must leave some for the rest of the page. */
const FOLLOWED = 3;

interface ListProps {
  runs: RunSummary[];
  names: Names | null;
  remove?: (run: RunSummary) => void;
  /** Instead of removing: the runs are deleted ones. */
  restore?: (run: RunSummary) => void;
  selected?: ReadonlySet<string>;
  select?: (id: string, on: boolean) => void;
}

export function RunList({ runs, ...shared }: ListProps) {
  const followed = new Set(
    runs
      .filter((run) => goesOn(run.state))
      .slice(0, FOLLOWED)
      .map((run) => run.id),
  );
  const { roots, variants } = families(runs);
  const row = (run: RunSummary) => <RunRow key={run.id} run={run} live={followed.has(run.id)} {...shared} />;
  return (
    <ul class="rows">
      {roots.map((run) => {
        const own = variants.get(run.id) ?? [];
        return (
          <li key={run.id}>
            {row(run)}
            {own.length > 0 && (
              <details class="variants">
                <summary>{text.assessment.variants(own.length)}</summary>
                {own.map(row)}
              </details>
            )}
          </li>
        );
      })}
    </ul>
  );
}

/** Runs that stand by themselves, and those that vary one of them, whatever they vary in between. */
export function families(runs: RunSummary[]): { roots: RunSummary[]; variants: Map<string, RunSummary[]> } {
  const known = new Map(runs.map((run) => [run.id, run]));
  const rootOf = (run: RunSummary): RunSummary => {
    const parent = run.variant_of === null ? undefined : known.get(run.variant_of);
    return parent && parent !== run ? rootOf(parent) : run;
  };
  const variants = new Map<string, RunSummary[]>();
  const roots: RunSummary[] = [];
  for (const run of runs) {
    const root = rootOf(run);
    if (root === run) roots.push(run);
    else variants.set(root.id, [...(variants.get(root.id) ?? []), run]);
  }
  return { roots, variants };
}

function RunRow({
  run,
  names,
  live,
  remove,
  restore,
  selected,
  select,
}: Omit<ListProps, "runs"> & { run: RunSummary; live: boolean }) {
  const standing = useStanding(run, live);
  const set = names?.set(run.measurement_set_id) ?? "…";
  const details = [
    run.positive ? text.options.constrained : text.options.unconstrained,
    ...(run.weighting === "covariance" ? [] : [text.weightings[run.weighting]]),
    ...(run.elasticity === "joints" ? [] : [text.elasticities[run.elasticity]]),
    ...(run.leave_out.length > 0 ? [text.lists.without(run.leave_out)] : []),
  ];
  const body = (
    <>
      <span class="what">
        <Name>{set}</Name>
        <small>
          <Name>{names?.robot(run.robot_id) ?? ""}</Name>
        </small>
      </span>
      <span class="how">
        {text.methods[run.method]}
        <small>{details.join(", ")}</small>
      </span>
      <Figures of={run} />
      <span class="when">
        <When time={run.created_at} />
      </span>
      <span class="standing">
        {run.verdict && standing.state === "succeeded" ? (
          <Badge verdict={run.verdict} />
        ) : (
          <State state={standing.state} />
        )}
        {run.variant_of !== null && <small>{text.assessment.variant}</small>}
        {goesOn(standing.state) && <Bar standing={standing} />}
      </span>
    </>
  );
  return (
    <div class="item">
      {select && run.state === "succeeded" && (
        <label class="pick">
          <input
            type="checkbox"
            aria-label={text.lists.select(set)}
            checked={selected?.has(run.id) ?? false}
            onChange={(event) => select(run.id, event.currentTarget.checked)}
          />
        </label>
      )}
      {restore ? (
        <div class="main">{body}</div>
      ) : (
        <a class="main" href={link(["runs", run.id])}>
          {body}
        </a>
      )}
      {restore && <Button onClick={() => restore(run)}>{text.lists.restore}</Button>}
      {remove && !goesOn(standing.state) && (
        <Button
          look="quiet icon"
          aria-label={text.runs.delete(set)}
          title={text.run.delete}
          onClick={() => remove(run)}
        >
          <svg viewBox="0 0 24 24" aria-hidden="true">
            <path d="M5 7h14M10 7V5h4v2M7 7l1 12h8l1-12M10.5 11v5M13.5 11v5" />
          </svg>
        </Button>
      )}
    </div>
  );
}

/** What a listing tells of a result. */
export function Figures({
  of: { compensation, joints_identified: found, joint_count: count, warning_count: warnings },
}: {
  of: Pick<RunSummary, "compensation" | "joints_identified" | "joint_count" | "warning_count">;
}) {
  return (
    <span class="figures">
      <span>
        {compensation !== null && (
          <>
            <b>{percent(compensation)}</b> <small>{text.lists.explained}</small>
          </>
        )}
      </span>
      <span>
        {found !== null && (
          <>
            <b>
              {found}/{count}
            </b>{" "}
            <small>{text.lists.joints}</small>
          </>
        )}
      </span>
      <span>
        {warnings !== null && warnings > 0 && (
          <>
            <b>{warnings}</b> <small>{text.lists.warnings(warnings)}</small>
          </>
        )}
      </span>
    </span>
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
