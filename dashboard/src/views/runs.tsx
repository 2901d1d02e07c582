/** Runs as rows, variants beneath the run they vary; and the list of all runs, compared side by side. */
import { useCallback, useState } from "preact/hooks";
import type { RunSummary } from "../api/types";
import { NameLink, Button, Title, Toggle } from "../components/basics";
import { type Row, Rows } from "../components/list";
import { type Names, useNames } from "../state/names";
import { valueOf } from "../state/load";
import { go, link } from "../state/router";
import { text } from "../i18n";
import { JobList, jobRow } from "./job_list";

/** As many are compared as there are marks. */
export const MOST_RUNS = 4;

/** What a run is about, as a row says it. */
function rowOf(run: RunSummary, names: Names | null): Pick<Row, "name"> & Partial<Row> {
  const name = names?.set(run.measurement_set_id) ?? "…";
  const constraint = run.positive ? text.options.constrained : text.options.unconstrained;
  const elasticity = run.elasticity === "joints" ? "" : text.elasticities[run.elasticity];
  const details = [
    constraint,
    ...(run.weighting === "covariance" ? [] : [text.weightings[run.weighting]]),
    ...(elasticity ? [elasticity] : []),
    ...(run.leave_out.length > 0 ? [text.lists.without(run.leave_out)] : []),
    ...(run.variant_of === null ? [] : [text.assessment.variant]),
  ];
  return {
    name,
    how: (
      <>
        {text.methods[run.method]}
        <small>{details.join(", ")}</small>
      </>
    ),
    words: [text.methods[run.method], text.glossary[run.method][0], ...details],
  };
}

/** Rows of runs for lists of their own. */
export const runRows = (runs: RunSummary[], names: Names | null): Row[] =>
  nested(
    runs.map((run) => jobRow("runs", run, names, rowOf(run, names), false)),
    runs,
  );

export const RunList = ({ runs, names }: { runs: RunSummary[]; names: Names | null }) => (
  <Rows rows={runRows(runs, names)} />
);

/** Rows of variants beneath that of the run they began with, whatever they vary in between. */
function nested(rows: Row[], runs: RunSummary[]): Row[] {
  const known = new Map(runs.map((run) => [run.id, run]));
  const rootOf = (run: RunSummary): RunSummary => {
    const parent = run.variant_of === null ? undefined : known.get(run.variant_of);
    return parent && parent !== run ? rootOf(parent) : run;
  };
  const ids = new Set(rows.map(({ id }) => id));
  const under = new Map<string, Row[]>();
  const roots: Row[] = [];
  for (const row of rows) {
    const run = known.get(row.id);
    const root = run ? rootOf(run).id : row.id;
    if (root === row.id || !ids.has(root)) roots.push(row);
    else under.set(root, [...(under.get(root) ?? []), row]);
  }
  return roots.map((row) => ({ ...row, under: under.get(row.id) ?? [] }));
}

export function RunsView({ query }: { query: URLSearchParams }) {
  const [grouped, setGrouped] = useState(query.get("group") === "set");
  const [selected, setSelected] = useState<ReadonlySet<string>>(new Set());
  const names = valueOf(useNames());
  const share = useCallback(
    (search: Record<string, string>) => {
      const kept = new URLSearchParams({ ...search, ...(grouped ? { group: "set" } : {}) }).toString();
      history.replaceState(null, "", `#/runs${kept && `?${kept}`}`);
    },
    [grouped],
  );
  const select = (id: string, on: boolean) =>
    setSelected((before) => new Set(on ? [...before, id] : [...before].filter((one) => one !== id)));
  const few = selected.size < 2 || selected.size > MOST_RUNS;
  return (
    <>
      <Title plain={text.runs.title}>{text.runs.title}</Title>
      <JobList
        collection="runs"
        names={names}
        query={query}
        address={share}
        row={(run) => rowOf(run, names)}
        pick={(run) =>
          run.state === "succeeded" && (
            <label class="pick">
              <input
                type="checkbox"
                aria-label={text.lists.select(names?.set(run.measurement_set_id) ?? run.id)}
                checked={selected.has(run.id)}
                onChange={(event) => select(run.id, event.currentTarget.checked)}
              />
            </label>
          )
        }
        arrange={(rows, runs) => {
          const sets = new Map(runs.map((run) => [run.id, run.measurement_set_id]));
          const groups = new Map<string | undefined, Row[]>();
          for (const row of nested(rows, runs)) {
            const set = grouped ? sets.get(row.id) : undefined;
            groups.set(set, [...(groups.get(set) ?? []), row]);
          }
          return [...groups].map(([set, members]) => [
            set !== undefined && (
              <h2 class="group">
                <NameLink to={["sets", set]}>{names?.set(set) ?? set}</NameLink>
              </h2>
            ),
            members,
          ]);
        }}
      >
        <Toggle label={text.lists.groups} checked={grouped} change={setGrouped} />
      </JobList>
      {selected.size > 0 && (
        <div class="selection" role="region" aria-label={text.lists.selected(selected.size)}>
          <b>{text.lists.selected(selected.size)}</b>
          <Button
            look="primary"
            disabled={few}
            onClick={() => go(link(["compare", "runs"], { ids: [...selected].join(",") }))}
          >
            {text.lists.compare}
          </Button>
          <Button look="quiet" onClick={() => setSelected(new Set())}>
            {text.lists.clear}
          </Button>
          {few && <small class="soft">{text.lists.selectTwo}</small>}
        </div>
      )}
    </>
  );
}
