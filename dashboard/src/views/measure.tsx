/** Where live campaigns begin: a goal, loads, targets and noise, declared before the first reading; or one that goes on. */
import { useEffect, useState } from "preact/hooks";
import { api } from "../api/client";
import type { MeasurementSetSummary, Plan } from "../api/types";
import { ActionButton, Choice, Name, NameLink, Show, Title } from "../components/basics";
import { Fields, NumberField, Select, TextField, VectorField } from "../components/fields";
import { type Asked, equipmentOf, optionsOf } from "../lib/planned";
import { posted, vectorIn } from "../lib/entered";
import { freshKey } from "../lib/hash";
import type { Fields as Document } from "../lib/json";
import {
  SIGMA,
  SIMULATED,
  SIMULATED_ARM,
  SIMULATED_LOAD_POINT,
  SIMULATED_MASS,
  SIMULATED_TARGETS,
  stiffnessesOf,
} from "../lib/simulated";
import { useAction } from "../state/action";
import { useLoad, valueOf } from "../state/load";
import { type Names, namesChanged, useNames } from "../state/names";
import { go, link } from "../state/router";
import { storedSet } from "../state/stored";
import { text } from "../i18n";
import { Equipment, START } from "./plans";
import { NoRobots } from "./robots";

const words = text.measure;
const SI = { length: "m", angle: "rad", force: "N" };

export function MeasureView({ query }: { query: URLSearchParams }) {
  const names = useNames();
  const planId = query.get("plan") ?? "";
  const plan = useLoad(async (signal) => (planId ? await api.plans.one(planId, signal) : null), [planId]);
  return (
    <>
      <div class="head">
        <Title plain={words.title}>{words.title}</Title>
        <div class="actions">
          <TrySimulated />
        </div>
      </div>
      <OpenCampaigns />
      <Show of={names}>
        {(known) => (
          <Show of={plan}>
            {(of) =>
              known.robots.length === 0 ? (
                <NoRobots />
              ) : (
                <Declaration names={known} robot={query.get("robot") ?? ""} plan={of} />
              )
            }
          </Show>
        )}
      </Show>
    </>
  );
}

/** Campaigns that are still measured, on this device or another. */
export function OpenCampaigns() {
  const open = valueOf(useLoad((signal) => api.openSets.list({ open: "true", limit: 20 }, signal), []));
  if (!open || open.items.length === 0) return null;
  return (
    <section class="card" aria-labelledby="open-campaigns">
      <h2 id="open-campaigns">{words.goOn}</h2>
      <ul>
        {open.items.map((set: MeasurementSetSummary) => (
          <li>
            <p class="meta">
              <NameLink to={["measure", set.id]}>{set.name}</NameLink>
              <span>{words.opened(set.observation_count)}</span>
            </p>
          </li>
        ))}
      </ul>
    </section>
  );
}

/** An arm of springs that the page computes: a whole campaign without a robot. */
export function TrySimulated() {
  const begin = useAction(async () => {
    const known = await api.robots.list({ limit: 100 });
    const robot =
      known.items.find(({ name }) => name === words.simulatedArm) ??
      (await api.robots.add(
        { name: words.simulatedArm, model: { format: "catalogue", arm: SIMULATED_ARM } },
        freshKey("robot"),
      ));
    const seed = Math.floor(1e6 * Math.random());
    const truth = stiffnessesOf(seed).map((stiffness) => (stiffness / 1e6).toPrecision(3));
    const set = await api.openSets.add(
      {
        robot_id: robot.id,
        name: words.simulatedName,
        units: SI,
        encoders: "motor",
        instrument: SIMULATED,
        notes: words.simulatedNotes(truth.join(", "), seed),
        noise: { sigma: SIGMA, load_point: 1e-4, force: { scale: 1e-3 } },
        load_point: SIMULATED_LOAD_POINT,
        flange_targets: SIMULATED_TARGETS,
        open: { goal: { kind: "joints", relative: 0.1 }, load: { kind: "dead_weight", mass: SIMULATED_MASS } },
      },
      freshKey("live"),
    );
    namesChanged();
    go(link(["measure", set.id]));
  }, "live");
  return (
    <ActionButton action={begin} going={words.trying}>
      {words.try}
    </ActionButton>
  );
}

type Kind = "deflection" | "joints" | "decision";

/** As typed: µm, mm, N, %. */
interface TypedGoal {
  kind: Kind;
  share: string;
  length: string;
  corners: [string, string];
  force: string;
}

const GOAL: TypedGoal = { kind: "deflection", share: "15", length: "", corners: ["", ""], force: "" };

/** The goal as it is posted, with its work area; null while something is missing. */
function goalOf({ kind, share, length, corners, force }: TypedGoal): Document | null {
  if (kind === "joints") return Number(share) > 0 ? { goal: { kind, relative: posted(share, 0.01) } } : null;
  const [a, b] = corners.map(vectorIn);
  const along = vectorIn(force);
  if (!a || !b || along === undefined || !(Number(length) > 0)) return null;
  const corner = (choose: (...values: number[]) => number) => a.map((part, i) => choose(part, b[i] as number) / 1e3);
  return {
    goal: {
      kind,
      [kind === "decision" ? "limit" : "uncertainty"]: posted(length, 1e-6),
      ...(along ? { force: along } : {}),
    },
    work_area: [corner(Math.min), corner(Math.max)],
  };
}

function Declaration({ names, robot: given, plan }: { names: Names; robot: string; plan: Plan | null }) {
  const planned = plan?.result ? plan : null;
  const ofSet = names.sets.find(({ id }) => id === planned?.request.measurement_set_id)?.robot_id;
  const fixed = planned ? (planned.request.robot_id ?? ofSet ?? "") : "";
  const only = names.robots.length === 1 ? (names.robots[0]?.id ?? "") : "";
  const [chosen, setRobot] = useState(given || only);
  const robot = fixed || chosen;
  const [name, setName] = useState("");
  const [asked, setAsked] = useState<Asked>(() => ({
    ...START,
    ...(planned?.request.sigma ? { sigma: micrometres(planned.request.sigma, "m") } : {}),
  }));
  const [goal, setGoal] = useState<TypedGoal>(() => ({
    ...GOAL,
    ...(planned?.request.work_area ? { corners: cornersOf(planned.request.work_area) } : {}),
  }));
  const [known, setKnown] = useState({ forceScale: "", loadPoint: "" });
  const earlier = names.sets.find((set) => set.robot_id === robot)?.id;
  const campaign = valueOf(useLoad(async () => (earlier ? await storedSet(earlier) : null), [earlier]));
  useEffect(() => {
    if (!campaign) return;
    const sigma = campaign.noise?.sigma;
    const found = { ...equipmentOf(campaign), ...(sigma ? { sigma: micrometres(sigma, campaign.units.length) } : {}) };
    setAsked((before) => ({ ...before, ...unchanged(found, before) }));
    const { force, load_point: place } = campaign.noise ?? {};
    const mm = campaign.units.length === "m" ? 1e3 : 1;
    setKnown((before) => ({
      forceScale: before.forceScale || (force?.scale ? shown(100 * force.scale) : ""),
      loadPoint: before.loadPoint || (place ? shown(mm * place) : ""),
    }));
  }, [campaign]);
  const options = optionsOf(asked);
  const declared = goalOf(goal);
  const ready =
    robot !== "" && declared !== null && (planned !== null || Boolean(asked.force.trim() && asked.targets.trim()));
  const begin = useAction(async () => {
    if (typeof options === "string" || !declared) return;
    const body = bodyOf({ robot, name: name.trim() || words.namePlaceholder, options, declared, plan: planned, known });
    const set = await api.openSets.add(body, freshKey("live"));
    go(link(["measure", set.id]));
  }, "live");
  return (
    <Fields action={begin} look="card form">
      <p>{words.intro}</p>
      <TextField label={words.name} value={name} placeholder={words.namePlaceholder} maxLength={200} change={setName} />
      {planned ? (
        <p class="soft">
          {words.ofPlan} <Name>{names.robot(robot)}</Name>
        </p>
      ) : (
        <Select
          label={words.robot}
          value={robot}
          change={setRobot}
          options={[
            { value: "", label: text.start.pick },
            ...names.robots.map(({ id }) => ({ value: id, label: names.robot(id) })),
          ]}
        />
      )}
      <GoalForm goal={goal} change={(part) => setGoal({ ...goal, ...part })} />
      {planned ? (
        <NumberField
          label={text.noise.sigma}
          unit={text.units.micrometre}
          value={asked.sigma}
          change={(sigma) => setAsked({ ...asked, sigma })}
        />
      ) : (
        <Equipment asked={asked} change={(part) => setAsked({ ...asked, ...part })} />
      )}
      <fieldset>
        <legend class="soft">{words.noise}</legend>
        <div class="map-fields">
          <NumberField
            label={words.forceScale}
            unit={text.units.share}
            path="noise.force"
            help={text.noise.forceScaleHelp}
            value={known.forceScale}
            change={(forceScale) => setKnown({ ...known, forceScale })}
          />
          <NumberField
            label={words.loadPoint}
            unit={text.units.mm}
            path="noise.load_point"
            help={text.noise.loadPointHelp}
            value={known.loadPoint}
            change={(loadPoint) => setKnown({ ...known, loadPoint })}
          />
        </div>
      </fieldset>
      {typeof options === "string" && <p class="note warn">{text.plan.unread(options)}</p>}
      {!ready && <p class="soft">{words.notReady}</p>}
      <ActionButton
        look="primary big"
        action={begin}
        disabled={!ready || typeof options === "string"}
        going={words.beginning}
      >
        {words.begin}
      </ActionButton>
    </Fields>
  );
}

function GoalForm({ goal, change }: { goal: TypedGoal; change: (part: Partial<TypedGoal>) => void }) {
  return (
    <>
      <Choice
        look="choice cards"
        label={words.goal}
        value={goal.kind}
        change={(kind: Kind) => change({ kind })}
        options={(["deflection", "joints", "decision"] as const).map((value) => ({ value, ...words.goals[value] }))}
      />
      <div class="map-fields">
        {goal.kind === "joints" ? (
          <NumberField
            label={words.share}
            unit={text.units.share}
            path="open.goal"
            value={goal.share}
            change={(share) => change({ share })}
          />
        ) : (
          <>
            <NumberField
              label={goal.kind === "decision" ? words.limit : words.uncertainty}
              unit={text.units.micrometre}
              path="open.goal"
              value={goal.length}
              change={(length) => change({ length })}
            />
            {([0, 1] as const).map((i) => (
              <VectorField
                label={words.corners[i]}
                unit={text.units.mm}
                path="open.work_area"
                value={goal.corners[i]}
                change={(typed) => change({ corners: i === 0 ? [typed, goal.corners[1]] : [goal.corners[0], typed] })}
              />
            ))}
            <VectorField
              label={words.force}
              unit={text.units.newton}
              value={goal.force}
              change={(force) => change({ force })}
            />
          </>
        )}
      </div>
    </>
  );
}

/** The open set to post. */
function bodyOf({
  robot,
  name,
  options: { readings: _, joints: _j, sigma, tracker, load_point: loadPoint, targets, ...equipment },
  declared,
  plan,
  known,
}: {
  robot: string;
  name: string;
  options: Document;
  declared: Document;
  plan: Plan | null;
  known: { forceScale: string; loadPoint: string };
}): Document {
  const [scale, place] = [posted(known.forceScale, 0.01), posted(known.loadPoint, 1e-3)];
  const noise = {
    ...(tracker ? { instrument: tracker } : sigma ? { sigma } : {}),
    ...(scale === null ? {} : { force: { scale } }),
    ...(place === null ? {} : { load_point: place }),
  };
  return {
    robot_id: robot,
    name,
    units: SI,
    encoders: "motor",
    ...(Object.keys(noise).length > 0 ? { noise } : {}),
    load_point: plan?.result?.load_point ?? loadPoint ?? [0, 0, 0],
    flange_targets: plan?.result?.targets ?? targets ?? {},
    open: { ...declared, ...(plan ? { plan_id: plan.id } : { ...equipment, ...(tracker ? { tracker } : {}) }) },
  };
}

const shown = (value: number): string => String(Number(value.toPrecision(4)));
const micrometres = (sigma: number, length: "m" | "mm"): string => shown(sigma * (length === "m" ? 1e6 : 1e3));

/** What was found of the fields that nobody has changed. */
const unchanged = (found: Partial<Asked>, now: Asked): Partial<Asked> =>
  Object.fromEntries(
    Object.entries(found).filter(([name]) => now[name as keyof Asked] === START[name as keyof Asked]),
  ) as Partial<Asked>;

const cornersOf = (area: readonly (readonly number[])[]): [string, string] => {
  const typed = (corner: readonly number[] | undefined) => (corner ?? []).map((part) => 1e3 * part).join(", ");
  return [typed(area[0]), typed(area[1])];
};
