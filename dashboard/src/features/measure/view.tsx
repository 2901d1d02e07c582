/** Where live campaigns begin: a goal, loads, targets and noise, declared before the first reading; or one that goes on. */
import { useLayoutEffect } from "preact/hooks";
import { api } from "../../api/calls";
import { queries } from "../../api/queries";
import type { Plan } from "../../api/types";
import { ActionButton, Choice, Head, Name, Show } from "../../components/basics";
import { RequestFields as Form, TextField } from "../../components/fields";
import { SchemaFields, type Terms, useDescribed } from "../../components/schema_form";
import { freshKey, type Fields, unreadIn } from "../../lib/json";
import * as live from "./live";
import { useAction, go, link } from "../../state/action";
import { RobotSelect } from "../../components/choosers";
import { likelyRobot, ROBOTS } from "../../state/choices";
import { isKnown, type Query, useQuery } from "../../state/query";
import { useTypedValue } from "../../state/session";
import { factors } from "../../lib/stiffness";
import { text } from "../../words";
import { NOISE } from "../readings/flow";
import { EQUIPMENT, Equipment, START, useEquipped } from "../plan/view";
import { NoRobots } from "../robots/view";

import { OPEN, OpenCampaigns, TrySimulated } from "./open_campaigns";
import { measureWords } from "./words";
import { SI } from "../../lib/observation";

const words = measureWords;

export function MeasureView({ query }: { query: URLSearchParams }) {
  const robots = useQuery(queries.robots(ROBOTS));
  const planId = query.get("plan") ?? "";
  const plan = useQuery({ ...queries.plan(planId), enabled: planId !== "" });
  const open = useQuery(queries.sets(OPEN));
  return (
    <>
      <Head plain={words.title} first={<TrySimulated />} />
      <OpenCampaigns as="h2" />
      <Show of={robots} instead={({ items }) => items.length === 0 && <NoRobots />}>
        {({ items, total }) => (
          <Show of={planId ? plan : { ...plan, data: null }}>
            {(of) => (
              <Declaration
                likely={likelyRobot({ items, total }, () => true)}
                robot={query.get("robot")}
                plan={of}
                after={open}
              />
            )}
          </Show>
        )}
      </Show>
    </>
  );
}

type Kind = keyof typeof GOALS;
const GOALS = { deflection: "DeflectionGoal", joints: "JointsGoal", decision: "DecisionGoal" } as const;

const GOAL: Terms = { labels: words.labels, within: "open.goal." };

interface DeclarationProps {
  /** The robot to begin with where none is given; empty for none. */
  likely: string;
  robot: string | null;
  plan: Plan | null;
  /** What is shown above the form. */
  after: Query<unknown>;
}

function Declaration({ likely, robot: given, plan, after }: DeclarationProps) {
  const planned = plan?.result ? plan : null;
  const base = planned?.request.measurement_set_id;
  const { data: ofSet, problem: noSet } = useQuery({ ...queries.set(base ?? ""), enabled: base != null });
  const fixed = planned ? (planned.request.robot_id ?? ofSet?.robot_id ?? "") : "";
  const form = `measure/${plan?.id ?? given ?? ""}`;
  const [chosen, setRobot] = useTypedValue(`${form}/robot`, given ?? likely);
  const robot = fixed || chosen;
  const [name, setName] = useTypedValue(`${form}/name`, "");
  const [asked, setAsked] = useTypedValue<Fields>(form, {
    ...START,
    ...(planned?.request.sigma ? { sigma: planned.request.sigma } : {}),
    work_area: planned?.request.work_area ?? null,
  });
  // A plan states all but the goal, and this goal needs no further field.
  const [kind, setKind] = useTypedValue<Kind>(`${form}/kind`, planned ? "joints" : "deflection");
  const [goal, setGoal] = useTypedValue<Fields>(`${form}/goal`, { relative: 0.15 });
  const [noise, setNoise] = useTypedValue<Fields>(`${form}/noise`, {});
  const campaign = useEquipped(robot);
  const ofRobot = useQuery({ ...queries.robot(fixed), enabled: fixed !== "" });
  const isRobotKnown = planned === null || isKnown(ofRobot) || noSet !== null;
  const isDescribed = useDescribed();
  useLayoutEffect(() => {
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
      units: SI,
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
    <Form
      action={begin}
      look="card form"
      known={isKnown(after) && isDescribed && isRobotKnown && campaign !== undefined}
    >
      <p>{words.intro}</p>
      <TextField label={words.name} value={name} placeholder={words.namePlaceholder} maxLength={200} change={setName} />
      {planned ? (
        <p class="soft">
          {words.ofPlan} <Name>{ofRobot.data?.name ?? "…"}</Name>
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
        <SchemaFields
          of="Noise"
          show={["force", "load_point", "grounds"]}
          value={noise}
          change={setNoise}
          terms={NOISE}
        />
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
