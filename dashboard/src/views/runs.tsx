/** All runs: searched, filtered, followed live, deleted with undo. */
import { useEffect, useMemo, useState } from "preact/hooks";
import { api, problemOf } from "../api/client";
import type { Page, Problem, RunState, RunSummary } from "../api/types";
import { Busy, Choice, Empty, ProblemNote, Title } from "../parts/basics";
import { type Names, useNames } from "../state/names";
import { valueOf } from "../state/load";
import { toast } from "../state/toasts";
import { text } from "../text";
import { RunList } from "./run_list";

type Filter = "all" | RunState;
const FILTERS: Filter[] = ["all", "succeeded", "queued", "running", "failed", "cancelled"];

export function RunsView({ query }: { query: URLSearchParams }) {
  const [search, setSearch] = useState(query.get("q") ?? "");
  const [state, setState] = useState<Filter>((query.get("state") as Filter | null) ?? "all");
  const names = valueOf(useNames());
  const { runs, more, problem, load, take, put } = useRunPages(state);
  useEffect(() => {
    const kept = new URLSearchParams({
      ...(search ? { q: search } : {}),
      ...(state === "all" ? {} : { state }),
    }).toString();
    history.replaceState(null, "", `#/runs${kept && `?${kept}`}`); // the search can be shared
  }, [search, state]);
  const found = useMemo(() => runs?.filter((run) => matches(run, search, names)) ?? [], [runs, search, names]);

  const remove = (run: RunSummary) => {
    const name = names?.set(run.measurement_set_id) ?? run.id;
    take(run.id);
    api.deleteRun(run.id).then(
      () => toast(text.runs.deleted(name), { label: text.runs.undo, run: () => restore(run) }),
      (error: unknown) => {
        put(run);
        toast(problemOf(error).detail);
      },
    );
  };
  const restore = (run: RunSummary) => {
    api.restoreRun(run.id).then(
      () => {
        put(run);
        toast(text.runs.restored);
      },
      (error: unknown) => toast(problemOf(error).detail),
    );
  };

  return (
    <>
      <Title plain={text.runs.title}>{text.runs.title}</Title>
      <div class="filters">
        <label class="field search">
          <span>{text.runs.search}</span>
          <input
            type="search"
            value={search}
            placeholder={text.runs.searchHint}
            onInput={(event) => setSearch(event.currentTarget.value)}
          />
        </label>
        <Choice
          label={text.runs.state}
          value={state}
          change={setState}
          options={FILTERS.map((value) => ({
            value,
            label: value === "all" ? text.app.all : (text.states[value] ?? value),
          }))}
        />
      </div>
      {problem && <ProblemNote problem={problem} retry={load} />}
      {runs === null && !problem && <Busy />}
      {runs && runs.length > 0 && (
        <p class="soft" role="status">
          {text.runs.count(found.length, runs.length)}
        </p>
      )}
      {runs && found.length > 0 && <RunList runs={found} names={names} remove={remove} />}
      {runs &&
        runs.length === 0 &&
        (state === "all" ? (
          <Empty title={text.runs.none} hint={text.runs.noneHint}>
            <a class="button primary" href="#/">
              {text.app.measure}
            </a>
          </Empty>
        ) : (
          <Empty title={text.runs.noMatch} hint={text.runs.noMatchHint} />
        ))}
      {runs && runs.length > 0 && found.length === 0 && (
        <Empty title={text.runs.noMatch} hint={text.runs.noMatchHint}>
          <button type="button" class="button" onClick={() => setSearch("")}>
            {text.runs.clear}
          </button>
        </Empty>
      )}
      {more && (
        <button type="button" class="button" onClick={more}>
          {text.app.more}
        </button>
      )}
    </>
  );
}

function matches(run: RunSummary, search: string, names: Names | null): boolean {
  const heap = [
    names?.set(run.measurement_set_id),
    names?.robot(run.robot_id),
    text.methods[run.method],
    text.methodShort[run.method],
    text.states[run.state],
    run.elasticity === "joints" ? "" : text.elasticities[run.elasticity],
    run.positive ? text.options.constrained : text.options.unconstrained,
    run.id,
    run.created_at,
  ]
    .join("\n")
    .toLowerCase();
  return search
    .toLowerCase()
    .split(/\s+/)
    .every((word) => heap.includes(word));
}

/** The listing page by page. */
function useRunPages(state: Filter) {
  const [runs, setRuns] = useState<RunSummary[] | null>(null);
  const [next, setNext] = useState<string | null>(null);
  const [problem, setProblem] = useState<Problem | null>(null);
  const filters = state === "all" ? {} : { state };
  const ask = (cursor: string | null, hear: (page: Page<RunSummary>) => void) => {
    setProblem(null);
    api.runs({ ...filters, limit: 100, cursor }).then(
      (page) => {
        hear(page);
        setNext(page.next);
      },
      (error: unknown) => setProblem(problemOf(error)),
    );
  };
  useEffect(() => {
    let gone = false;
    setRuns(null);
    ask(null, (page) => gone || setRuns(page.items));
    return () => {
      gone = true;
    };
  }, [state]);
  return {
    runs,
    problem,
    load: () => ask(null, (page) => setRuns(page.items)),
    more: next === null ? null : () => ask(next, (page) => setRuns((before) => [...(before ?? []), ...page.items])),
    take: (id: string) => setRuns((before) => before?.filter((run) => run.id !== id) ?? null),
    put: (run: RunSummary) =>
      setRuns((before) => [...(before ?? []), run].sort((a, b) => (a.created_at < b.created_at ? 1 : -1))),
  };
}
