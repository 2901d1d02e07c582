/** Where comparisons start: methods on one set, or two sets; their runs are made first. */
import { useState } from "preact/hooks";
import { api } from "../api/client";
import type { RunSummary } from "../api/types";
import { ActionButton, Empty, LinkButton, Show, Tabs, timeText, Title, Toggle } from "../components/basics";
import { Select } from "../components/fields";
import { useAction } from "../state/action";
import { compareMethods, compareSides, type SideOf } from "../state/comparing";
import { useLoad, valueOf } from "../state/load";
import { type Names, setOptions, useNames } from "../state/names";
import { link, parse } from "../state/router";
import { text } from "../i18n";
import { later } from "../i18n/later";
import { JobList } from "./job_list";

const words = later.compare;
const KINDS = ["methods", "pairs"] as const;

export function CompareView({ kind }: { kind: string }) {
  const names = useNames();
  return (
    <>
      <Title plain={words.title}>{words.title}</Title>
      <Tabs
        label={words.tabs}
        current={kind}
        tabs={KINDS.map((id) => ({ id, label: words[id], href: link(["compare", id]) }))}
      />
      <Show of={names}>
        {(known) =>
          known.sets.length === 0 ? (
            <Empty title={later.robots.setsNone} hint={words.noSets}>
              <LinkButton look="primary" href="#/">
                {text.app.measure}
              </LinkButton>
            </Empty>
          ) : (
            <>
              {kind === "pairs" ? <StartPair names={known} /> : <StartMethods names={known} />}
              <JobList
                collection="comparisons"
                title={text.earlier.comparisons}
                names={known}
                row={({ first_set_id: first, second_set_id: second }) => ({
                  name: second ? later.pair.title(known.set(first), known.set(second)) : known.set(first),
                })}
              />
            </>
          )
        }
      </Show>
    </>
  );
}

function StartMethods({ names }: { names: Names }) {
  const [set, setSet] = useState(parse(location.hash).query.get("set") ?? names.sets[0]?.id ?? "");
  const [resample, setResample] = useState(false);
  const start = useAction(async () => {
    const size = Math.max(1, Math.round((names.sets.find((s) => s.id === set)?.observation_count ?? 20) / 2));
    const resampling = resample ? { size, repetitions: 200, seed: 1 } : null;
    const comparison = await compareMethods(set, resampling);
    return link(["compare", "methods", comparison.id]);
  });
  return (
    <section class="card form">
      <p>{words.methodsIntro}</p>
      <Select label={text.sets.kind} value={set} change={setSet} options={setOptions(names)} />
      <Toggle label={words.resample} checked={resample} change={setResample} />
      <ActionButton look="primary" action={start} disabled={!set} going={words.going}>
        {words.go}
      </ActionButton>
    </section>
  );
}

/** A side as the select box holds it: `set:…` or `run:…`. */
async function side(chosen: string): Promise<SideOf> {
  const [kind, id = ""] = chosen.split(":", 2);
  return kind === "run" ? { run: await api.runs.one(id) } : { set: id };
}

/** Method, constraint and weights of a run, short. */
function howRun(run: RunSummary): string {
  const method = `${text.methods[run.method]} ${run.positive ? text.options.constrained : text.options.unconstrained}`;
  return run.weighting === "covariance" ? method : `${method}, ${text.weightings[run.weighting]}`;
}

function sideOptions(names: Names, runs: RunSummary[]): { value: string; label: string }[] {
  return [
    ...setOptions(names).map(({ value, label }) => ({ value: `set:${value}`, label })),
    ...runs.map((run) => ({
      value: `run:${run.id}`,
      label: words.runSide(names.set(run.measurement_set_id), howRun(run), timeText(run.created_at)),
    })),
  ];
}

function StartPair({ names }: { names: Names }) {
  const runs =
    valueOf(useLoad((signal) => api.runs.list({ elasticity: "joints", state: "succeeded", limit: 100 }, signal), []))
      ?.items ?? [];
  const options = sideOptions(names, runs);
  const newest = names.sets[0];
  const others = names.sets.filter((set) => set.id !== newest?.id && set.robot_id === newest?.robot_id);
  const unlike = others.find((set) => set.encoders !== newest?.encoders);
  const other = unlike ?? others[0] ?? names.sets[1];
  const [begin, end] = unlike?.encoders === "secondary" ? [newest, unlike] : [other, newest];
  const query = parse(location.hash).query;
  const [first, setFirst] = useState(query.get("first") ?? `set:${begin?.id ?? ""}`);
  const [second, setSecond] = useState(query.get("second") ?? `set:${end?.id ?? ""}`);
  const [ordered, setOrdered] = useState(unlike !== undefined && !query.has("first") && !query.has("second"));
  const [methods, setMethods] = useState(false);
  const choose = (set: (side: string) => void) => (chosen: string) => {
    set(chosen);
    setOrdered(false);
  };
  const start = useAction(async () => {
    const sides = await Promise.all([side(first), side(second)]);
    const pair = await compareSides(sides, ordered, methods);
    return link(["compare", "methods", pair.id]);
  }, "pair");
  const possible = !first.endsWith(":") && !second.endsWith(":") && first !== second;
  return (
    <section class="card form">
      <p>{words.pairsIntro}</p>
      <div class="row">
        <Select label={words.first} help={words.firstHint} value={first} change={choose(setFirst)} options={options} />
        <Select
          label={words.second}
          help={words.secondHint}
          value={second}
          change={choose(setSecond)}
          options={options}
        />
      </div>
      <Toggle label={words.ordered} checked={ordered} change={setOrdered} />
      <Toggle label={words.allMethods} checked={methods} change={setMethods} />
      {!possible && <p class="soft">{words.twoSets}</p>}
      <ActionButton look="primary" action={start} disabled={!possible} going={words.going}>
        {words.go}
      </ActionButton>
    </section>
  );
}
