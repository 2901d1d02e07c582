/** All runs: searched, filtered, followed live, deleted with undo. */
import { useEffect, useMemo, useState } from "preact/hooks";
import { api, problemOf } from "../api/client";
import type { Page, Problem, RunState, RunSummary, Usability } from "../api/types";
import { VerdictFilter } from "../components/badge";
import { Busy, Button, Choice, Empty, LinkButton, Name, ProblemNote, Title, Toggle } from "../components/basics";
import { Select } from "../components/fields";
import { type Names, useNames } from "../state/names";
import { valueOf } from "../state/load";
import { go, link } from "../state/router";
import { toast } from "../state/toasts";
import { text } from "../i18n";
import { RunList } from "./run_list";
import { MOST_RUNS } from "./side_by_side";

type Filter = "all" | "deleted" | RunState;
const FILTERS: Filter[] = ["all", "succeeded", "running", "failed", "cancelled", "deleted"];

export function RunsView({ query }: { query: URLSearchParams }) {
  const [search, setSearch] = useState(query.get("q") ?? "");
  const [state, setState] = useState<Filter>((query.get("state") as Filter | null) ?? "all");
  const [robot, setRobot] = useState(query.get("robot") ?? "");
  const [verdict, setVerdict] = useState<Usability | "">((query.get("verdict") as Usability | null) ?? "");
  const [grouped, setGrouped] = useState(query.get("group") === "set");
  const [selected, setSelected] = useState<ReadonlySet<string>>(new Set());
  const names = valueOf(useNames());
  const { runs, more, problem, load, take, put } = useRunPages(state, robot, verdict);
  useEffect(() => {
    const kept = new URLSearchParams({
      ...(search ? { q: search } : {}),
      ...(state === "all" ? {} : { state }),
      ...(robot ? { robot } : {}),
      ...(verdict ? { verdict } : {}),
      ...(grouped ? { group: "set" } : {}),
    }).toString();
    history.replaceState(null, "", `#/runs${kept && `?${kept}`}`); // the search can be shared
  }, [search, state, robot, verdict, grouped]);
  const found = useMemo(() => runs?.filter((run) => matches(run, search, names)) ?? [], [runs, search, names]);

  const remove = (run: RunSummary) => {
    const name = names?.set(run.measurement_set_id) ?? run.id;
    take(run.id);
    api.runs.delete(run.id).then(
      () => toast(text.runs.deleted(name), { label: text.runs.undo, run: () => restore(run) }),
      (error: unknown) => {
        put(run);
        toast(problemOf(error).detail);
      },
    );
  };
  const restore = (run: RunSummary) => {
    api.runs.restore(run.id).then(
      () => {
        if (state === "deleted") take(run.id);
        else put(run);
        toast(text.runs.restored);
      },
      (error: unknown) => toast(problemOf(error).detail),
    );
  };

  const select = (id: string, on: boolean) =>
    setSelected((before) => new Set(on ? [...before, id] : [...before].filter((one) => one !== id)));

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
            label: value === "all" ? text.app.all : value === "deleted" ? text.lists.deleted : text.states[value],
          }))}
        />
        {names && names.robots.length > 1 && (
          <Select
            label={text.lists.robot}
            value={robot}
            change={setRobot}
            options={[
              { value: "", label: text.app.all },
              ...names.robots.map(({ id }) => ({ value: id, label: names.robot(id) })),
            ]}
          />
        )}
        <VerdictFilter value={verdict} change={setVerdict} />
        <Toggle label={text.lists.groups} checked={grouped} change={setGrouped} />
      </div>
      {state === "deleted" && <p class="soft">{text.lists.deletedHint}</p>}
      {problem && <ProblemNote problem={problem} retry={load} />}
      {runs === null && !problem && <Busy />}
      {runs && runs.length > 0 && (
        <p class="soft" role="status">
          {text.runs.count(found.length, runs.length)}
        </p>
      )}
      {groupsOf(found, grouped).map(([set, members]) => (
        <section>
          {set !== null && (
            <h2 class="group">
              <a href={link(["sets", set])}>
                <Name>{names?.set(set) ?? set}</Name>
              </a>{" "}
              <small class="soft">{text.runs.count(members.length, members.length)}</small>
            </h2>
          )}
          <RunList
            runs={members}
            names={names}
            {...(state === "deleted" ? { restore } : { remove, selected, select })}
          />
        </section>
      ))}
      {selected.size > 0 && (
        <div class="selection" role="region" aria-label={text.lists.selected(selected.size)}>
          <b>{text.lists.selected(selected.size)}</b>
          <Button
            look="primary"
            disabled={selected.size < 2 || selected.size > MOST_RUNS}
            onClick={() => go(link(["compare", "runs"], { ids: [...selected].join(",") }))}
          >
            {text.lists.compare}
          </Button>
          <Button look="quiet" onClick={() => setSelected(new Set())}>
            {text.lists.clear}
          </Button>
          {(selected.size < 2 || selected.size > MOST_RUNS) && <small class="soft">{text.lists.selectTwo}</small>}
        </div>
      )}
      {runs &&
        runs.length === 0 &&
        (state === "all" ? (
          <Empty title={text.runs.none} hint={text.runs.noneHint}>
            <LinkButton look="primary" href="#/">
              {text.app.measure}
            </LinkButton>
          </Empty>
        ) : (
          <Empty title={text.runs.noMatch} hint={text.runs.noMatchHint} />
        ))}
      {runs && runs.length > 0 && found.length === 0 && (
        <Empty title={text.runs.noMatch} hint={text.runs.noMatchHint}>
          <Button onClick={() => setSearch("")}>{text.runs.clear}</Button>
        </Empty>
      )}
      {more && <Button onClick={more}>{text.app.more}</Button>}
    </>
  );
}

/** By set, in the order of each set's newest run; one group without a set if not wanted. */
function groupsOf(runs: RunSummary[], grouped: boolean): [string | null, RunSummary[]][] {
  if (!grouped) return runs.length > 0 ? [[null, runs]] : [];
  const groups = new Map<string, RunSummary[]>();
  for (const run of runs) groups.set(run.measurement_set_id, [...(groups.get(run.measurement_set_id) ?? []), run]);
  return [...groups];
}

function matches(run: RunSummary, search: string, names: Names | null): boolean {
  const heap = [
    names?.set(run.measurement_set_id),
    names?.robot(run.robot_id),
    text.methods[run.method],
    text.glossary[run.method][0],
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
function useRunPages(state: Filter, robot: string, verdict: Usability | "") {
  const [runs, setRuns] = useState<RunSummary[] | null>(null);
  const [next, setNext] = useState<string | null>(null);
  const [problem, setProblem] = useState<Problem | null>(null);
  const filters = {
    ...(state === "all" ? {} : state === "deleted" ? { deleted: "true" } : { state }),
    ...(robot ? { robot_id: robot } : {}),
    ...(verdict ? { verdict } : {}),
  };
  const ask = (cursor: string | null, hear: (page: Page<RunSummary>) => void) => {
    setProblem(null);
    api.runs.list({ ...filters, limit: 100, cursor }).then(
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
  }, [state, robot, verdict]);
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
