/** Where live campaigns begin: a goal, loads, targets and noise, declared before the first reading; or one that goes on. */
import { useEffect, useState } from "preact/hooks";
import { api } from "../api/calls";
import { problemOf } from "../api/problem";
import { queries } from "../api/queries";
import type { Plan } from "../api/types";
import { ActionButton, Choice, Head, Name, Show } from "../components/basics";
import { RequestFields as Form, TextField } from "../components/fields";
import { SchemaFields, type Terms } from "../components/schema_form";
import { freshKey, type Fields, unreadIn } from "../lib/json";
import * as live from "../lib/live";
import { useAction, go, link, toast } from "../state/action";
import { RobotSelect } from "../components/choosers";
import { ROBOTS } from "../state/choices";
import { send, useQuery } from "../state/query";
import { factors } from "../lib/stiffness";
import { text } from "../i18n";
import { later } from "../i18n/later";
import { NOISE } from "./flow";
import { EQUIPMENT, Equipment, START, useEquipped } from "./plans";
import { NoRobots } from "./robots";
import { DeleteButton, Rows } from "../components/list";

const words = later.measure;

export function MeasureView({ query }: { query: URLSearchParams }) {
  const robots = useQuery(queries.robots(ROBOTS));
  const planId = query.get("plan") ?? "";
  const plan = useQuery({ ...queries.plan(planId), enabled: planId !== "" });
  return (
    <>
      <Head plain={words.title} first={<TrySimulated />} />
      <OpenCampaigns />
      <Show of={robots} instead={({ items }) => items.length === 0 && <NoRobots />}>
        {({ items }) => (
          <Show of={planId ? plan : { ...plan, data: null }}>
            {(of) => (
              <Declaration only={items.length === 1 ? items[0]?.id : undefined} robot={query.get("robot")} plan={of} />
            )}
          </Show>
        )}
      </Show>
    </>
  );
}

/** Campaigns that are still measured, on this device or another. */
export function OpenCampaigns() {
  const { data: open } = useQuery(queries.sets({ open: true, limit: 20 }));
  if (!open || open.items.length === 0) return null;
  const failed = (error: unknown) => toast(problemOf(error).detail);
  const remove = (id: string, name: string) =>
    void send(() => api.openSets.delete(id)).then(() => {
      const restore = () => void send(() => api.openSets.restore(id)).catch(failed);
      toast(text.deletion.done(name), { label: text.runs.undo, run: restore });
    }, failed);
  return (
    <section class="card" aria-labelledby="open-campaigns">
      <h2 id="open-campaigns">{words.goOn}</h2>
      <Rows
        rows={open.items.map(({ id, name, observation_count: count }) => ({
          id,
          name,
          href: link(["measure", id]),
          how: words.opened(count),
          actions: <DeleteButton name={name} remove={() => remove(id, name)} />,
        }))}
      />
    </section>
  );
}

/** An arm of springs that the page computes: a whole campaign without a robot. */
export function TrySimulated() {
  const begin = useAction(async () => {
    const known = await api.robots.list({ name: words.simulatedArm, limit: 1 });
    const robot =
      known.items[0] ??
      (await api.robots.add(
        { name: words.simulatedArm, model: { format: "catalogue", arm: live.SIMULATED_ARM } },
        freshKey("robot"),
      ));
    const truth = live.SIMULATED_STIFFNESSES.map((stiffness) => (stiffness / 1e6).toPrecision(3));
    const set = await api.openSets.add(
      {
        robot_id: robot.id,
        name: words.simulatedName,
        units: live.SI,
        encoders: "motor",
        instrument: live.SIMULATED,
        notes: words.simulatedNotes(truth.join(", ")),
        noise: { sigma: live.SIGMA, load_point: 1e-4, force: { scale: 1e-3 } },
        load_point: live.SIMULATED_LOAD_POINT,
        flange_targets: live.SIMULATED_TARGETS,
        open: { goal: { kind: "joints", relative: 0.1 }, load: { kind: "dead_weight", mass: live.SIMULATED_MASS } },
      },
      freshKey("live"),
    );
    go(link(["measure", set.id]));
  }, "live");
  return (
    <ActionButton action={begin} going={words.trying}>
      {words.try}
    </ActionButton>
  );
}

type Kind = keyof typeof GOALS;
const GOALS = { deflection: "DeflectionGoal", joints: "JointsGoal", decision: "DecisionGoal" } as const;

const GOAL: Terms = { labels: words.labels, within: "open.goal." };

interface DeclarationProps {
  /** The only robot that there is. */
  only: string | undefined;
  robot: string | null;
  plan: Plan | null;
}

function Declaration({ only, robot: given, plan }: DeclarationProps) {
  const planned = plan?.result ? plan : null;
  const base = planned?.request.measurement_set_id;
  const { data: ofSet } = useQuery({ ...queries.set(base ?? ""), enabled: base != null });
  const fixed = planned ? (planned.request.robot_id ?? ofSet?.robot_id ?? "") : "";
  const [chosen, setRobot] = useState(given ?? only ?? "");
  const robot = fixed || chosen;
  const [name, setName] = useState("");
  const [asked, setAsked] = useState<Fields>(() => ({
    ...START,
    ...(planned?.request.sigma ? { sigma: planned.request.sigma } : {}),
    work_area: planned?.request.work_area ?? null,
  }));
  const [kind, setKind] = useState<Kind>("deflection");
  const [goal, setGoal] = useState<Fields>({ relative: 0.15 });
  const [noise, setNoise] = useState<Fields>({});
  const campaign = useEquipped(robot);
  const { data: ofRobot } = useQuery({ ...queries.robot(fixed), enabled: fixed !== "" });
  useEffect(() => {
    if (!campaign) return;
    const { set, equipment } = campaign;
    const { length } = factors(set.units);
    const { sigma, force, load_point: place } = set.noise ?? {};
    const found = { ...equipment, ...(sigma ? { sigma: sigma * length } : {}) };
    setAsked((before) => ({ ...before, ...live.unchanged(found, before, START) }));
    setNoise((before) => ({
      ...(force ? { force } : {}),
      ...(place != null ? { load_point: place * length } : {}),
      ...before,
    }));
  }, [campaign]);
  const shown = { joints: ["relative"], deflection: ["uncertainty", "force"], decision: ["limit", "force"] }[kind];
  const declared = kind === "joints" ? goal["relative"] : asked["work_area"] && goal[shown[0] ?? ""];
  const ready = robot !== "" && Boolean(declared) && (planned !== null || Boolean(asked["load"] && asked["targets"]));
  const begin = useAction(async () => {
    const { sigma, tracker, load_point: point, targets, work_area: area, surroundings, load } = asked;
    const { load_point: place, targets: places } = planned?.result ?? { load_point: point, targets };
    const body = {
      robot_id: robot,
      name: name.trim() || words.namePlaceholder,
      units: live.SI,
      encoders: "motor",
      noise: { ...noise, ...(tracker ? { instrument: tracker } : sigma != null ? { sigma } : {}) },
      load_point: place ?? [0, 0, 0],
      flange_targets: places ?? {},
      open: {
        goal: { kind, ...Object.fromEntries(shown.flatMap((each) => (goal[each] ? [[each, goal[each]]] : []))) },
        ...(kind === "joints" ? {} : { work_area: boxOf(area) }),
        ...(planned
          ? { plan_id: planned.id }
          : { load, ...(tracker ? { tracker } : {}), surroundings: surroundings ?? {} }),
      },
    };
    const set = await api.openSets.add(body, freshKey("live"));
    go(link(["measure", set.id]));
  }, "live");
  const equipment = {
    of: "LiveOptions",
    value: asked,
    change: setAsked,
    terms: { ...EQUIPMENT, within: "open." },
  };
  return (
    <Form action={begin} look="card form">
      <p>{words.intro}</p>
      <TextField label={words.name} value={name} placeholder={words.namePlaceholder} maxLength={200} change={setName} />
      {planned ? (
        <p class="soft">
          {words.ofPlan} <Name>{ofRobot?.name ?? "…"}</Name>
        </p>
      ) : (
        <RobotSelect label={words.robot} value={robot} change={setRobot} none={text.start.pick} />
      )}
      <Choice
        look="choice cards"
        label={words.goal}
        value={kind}
        change={setKind}
        options={(Object.keys(GOALS) as Kind[]).map((value) => ({ value, ...words.goals[value] }))}
      />
      <SchemaFields of={GOALS[kind]} show={shown} value={goal} change={setGoal} terms={GOAL} />
      {kind !== "joints" && <SchemaFields {...equipment} show={["work_area"]} />}
      {planned ? <SchemaFields {...equipment} show={["sigma"]} /> : <Equipment {...equipment} />}
      <fieldset>
        <legend class="soft">{words.noise}</legend>
        <SchemaFields of="Noise" show={["force", "load_point"]} value={noise} change={setNoise} terms={NOISE} />
      </fieldset>
      {!ready && <p class="soft">{words.notReady}</p>}
      <ActionButton
        look="primary big"
        action={begin}
        disabled={!ready || unreadIn([asked, goal, noise]) !== null}
        going={words.beginning}
      >
        {words.begin}
      </ActionButton>
    </Form>
  );
}

/** Two opposite corners as least and greatest. */
function boxOf(area: unknown): unknown {
  const [a = [], b = []] = area as number[][];
  return [a.map((part, i) => Math.min(part, b[i] ?? part)), a.map((part, i) => Math.max(part, b[i] ?? part))];
}
