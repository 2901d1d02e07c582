/** Plans: where they start, and one with its promise, its certificate and its postures. */
import { useState, useLayoutEffect } from "preact/hooks";
import { api } from "../../api/calls";
import { queries } from "../../api/queries";
import type { JointKind, MeasurementSet, PlanResult, Robot, Run } from "../../api/types";
import { Busy, Button, ActionButton, Show, Title, Download, LinkButton, Name, NameLink } from "../../components/basics";
import { fixed } from "../../lib/format";
import { equipmentOf, unchanged, toFillIn } from "../measure/live";
import { position, positionUnit } from "../../lib/stiffness";
import { type Vector, norm } from "../../lib/vector";
import { ArmView, roomOf } from "../../scene/view";
import { SearchedSelect, useRobotChoices, useSetChoices } from "../../components/choosers";
import { ROBOTS } from "../../state/choices";
import { ask, isKnown, useQuery } from "../../state/query";
import { text } from "../../words";
import { alongText } from "../run/joint_table";
import { RequestFields as Form } from "../../components/fields";
import { SchemaFields, type Terms, useDescribed } from "../../components/schema_form";
import { freshKey, type Fields, isFields, unreadIn } from "../../lib/json";
import { asking, useAction, link } from "../../state/action";
import { useDraft } from "../../state/session";
import { JobList } from "../runs/view";
import { NoRobots } from "../robots/view";
import { fileName, saveJson } from "../../components/table";
import { JobLines, JobPage, JobTables } from "../../components/job_page";
import { posturesOf } from "../../state/run_context";
import { measureWords } from "../measure/words";
import { gearboxWords } from "../gearbox/words";
import { planWords } from "./words";
import { nextWords } from "../run/words";

const words = planWords;

export function Postures({ result, robot }: { result: PlanResult; robot: Robot }) {
  const [chosen, choose] = useState(0);
  const { readings } = result;
  const shown = readings[chosen];
  const joints = readings.map((each) => each.joints);
  const { data: drawn } = useQuery(queries.kinematics({ robot_id: robot.id }, joints));
  const posture = drawn?.[chosen];
  return (
    <div class="flow">
      <section class="card" aria-labelledby="postures">
        <h2 id="postures">{words.postures}</h2>
        <div class="scroll">
          <table class="postures">
            <thead>
              <tr>
                <th>{words.reading}</th>
                {robot.joints.map(({ name, kind }) => (
                  <th class="number">
                    <Name>{name}</Name> [{positionUnit(kind).trim()}]
                  </th>
                ))}
                <th>{words.load}</th>
              </tr>
            </thead>
            <tbody>
              {readings.map((each, i) => (
                <tr class={i === chosen ? "shown" : undefined} onClick={() => choose(i)}>
                  <th scope="row">
                    <Button look="quiet" aria-label={words.show(each.label)} aria-pressed={i === chosen}>
                      {each.label}
                    </Button>
                  </th>
                  {each.joints.map((value, j) => (
                    <td class="number">{fixed(position(value, robot.joints[j]?.kind), 0)}</td>
                  ))}
                  <td>{loadOf(each)}</td>
                </tr>
              ))}
            </tbody>
          </table>
        </div>
      </section>
      {shown && (
        <section class="card sticky" aria-labelledby="current">
          <h2 id="current">{words.posture(shown.label)}</h2>
          <ArmView
            posture={posture}
            load={posture ? { from: posture.flange_origin, along: shown.force } : null}
            names={robot.joints.map(({ name }) => name)}
            room={roomOf(drawn ?? [])}
            label={words.drawn(shown.label)}
          />
          <p class="angles">
            {shown.joints.map((angle, i) => (
              <span>
                <small class="soft">
                  <Name>{robot.joints[i]?.name ?? ""}</Name>
                </small>{" "}
                <b>{shownJoint(angle, robot.joints[i]?.kind, 1)}</b>
              </span>
            ))}
          </p>
          <p>
            {nextWords.load(loadOf(shown))}
            {shown.direction && `; ${words.readAlong(shown.direction.map((part) => fixed(part, 2)).join(", "))}`}
            {shown.held_out && <span class="soft"> ({words.heldOut})</span>}
          </p>
        </section>
      )}
    </div>
  );
}

export const shownJoint = (value: number, kind: JointKind | undefined, decimals: number): string =>
  `${fixed(position(value, kind), decimals)}${positionUnit(kind)}`;

export function loadOf({ force, anchor }: { force: readonly number[]; anchor: number | null }): string {
  const size = norm(force as unknown as Vector) || 1;
  const how = anchor === null ? alongText(force as unknown as Vector) : words.anchor(anchor + 1);
  return `${fixed(size, 0)} ${text.units.newton} ${how}`;
}

export const START: Fields = { sigma: 2e-5 };
const WIDTH = { constant: 2e-5, per_distance: 0 };

/** What is measured with, in the units of a workshop. */
export const EQUIPMENT: Terms = {
  labels: words.labels,
  seeds: { tracker: { range: WIDTH, transverse: WIDTH } },
  units: { "tracker.station": [text.units.mm, 1e-3], "weight_step.noise": ["µrad", 1e-6] },
  hidden: [
    ...["inside", "obstacles", "link_radius", "facing", "acceptance"].map((name) => `surroundings.${name}`),
    ...["gravity", "balancers"].map((name) => `load.${name}`),
  ],
};

/** The same of a weight step. */
const OF_STEP_TERMS: Terms = { ...EQUIPMENT, labels: { ...words.labels, ...words.labelsOfStep } };

export function PlansView({ query }: { query: URLSearchParams }) {
  const robots = useQuery(queries.robots(ROBOTS));
  const given = query.get("set") ? `set:${query.get("set")}` : query.get("robot") ? `robot:${query.get("robot")}` : "";
  const isStep = query.has("step");
  return (
    <>
      <Title plain={words.begin}>{words.begin}</Title>
      <Show of={robots} instead={({ items }) => items.length === 0 && <NoRobots />}>
        {() => (
          <>
            <Begin key={String(isStep)} {...{ given, isStep }} after={query.get("run")} />
            <JobList collection="plans" />
          </>
        )}
      </Show>
    </>
  );
}

/** A campaign, and what it was measured with; its targets by its first posture where it does not state them. */
async function equippedSet(id: string): Promise<{ set: MeasurementSet; equipment: Fields }> {
  const set = await ask(queries.set(id));
  const alone = { ...set, observations: set.observations.slice(0, 1) };
  const [first] = await posturesOf(alone, await ask(queries.robot(set.robot_id)));
  return { set, equipment: equipmentOf(set, first) };
}

/** The last campaign of a robot and what it was measured with; undefined until it is known, null if there is none. */
export function useEquipped(robot: string) {
  const { data, problem } = useQuery({
    queryKey: ["equipped", robot],
    queryFn: async () => {
      const [last] = (await ask(queries.sets({ robot_id: robot, limit: 1 }))).items;
      return last ? equippedSet(last.id) : null;
    },
    enabled: robot !== "",
  });
  return robot === "" || problem ? null : data;
}

/** Fields of a plan of a weight step: all others concern targets. */
const OF_STEP = ["readings", "weight_step", "load_point", "joints"];
/** Postures that are good practice for a weight step. */
const STEP = { weight_step: {}, readings: 12 };

/**
 * `after`: the run of the campaign so far, whose causes and omitted readings hold on. `isStep`: whether the form begins
 * with a weight step.
 */
function Begin({ given, isStep, after }: { given: string; isStep: boolean; after: string | null }) {
  const [subject, setSubject] = useState(given);
  const [asked, change] = useDraft<Fields>(
    isStep ? `plan/step/${given}` : `plan/${given}`,
    given.startsWith("set:") ? {} : isStep ? { ...START, ...STEP } : START,
  );
  const [kind, id = ""] = subject.split(":", 2);
  const unread = unreadIn(asked);
  const step = kind !== "set" && isFields(asked["weight_step"]) ? asked["weight_step"] : null;
  const states = step ? step["mass"] && asked["load_point"] : asked["load"] && asked["targets"];
  const ready = kind === "set" || Boolean(states);
  const ofRun = useQuery({ ...queries.run(after ?? ""), enabled: after !== null });
  const { data: run } = ofRun;
  const so = run?.request.measurement_set_id === id ? run?.request : null;
  const { causes = [], leave_out: left = [] } = so ?? {};
  const start = useAction(async () => {
    const whose = kind === "set" ? { measurement_set_id: id } : { robot_id: id };
    const held = so ? { causes, leave_out: left } : {};
    const concerns = ([name, value]: [string, unknown]) =>
      value !== null && (step ? OF_STEP.includes(name) : name !== "weight_step");
    const stated = Object.fromEntries(Object.entries(asked).filter(concerns));
    const plan = await asking((accepted) =>
      api.plans.add({ ...whose, ...held, ...stated, ...accepted }, freshKey("plan")),
    );
    return link(["plans", plan.id]);
  }, "plan");
  const pick = (value: string) => {
    setSubject(value);
    change({ joints: [], sigma: value.startsWith("set:") ? null : START["sigma"] });
  };
  const campaign = useEquipped(kind === "robot" ? id : "");
  // Before it is painted: the fields would grow.
  useLayoutEffect(() => {
    if (campaign) change((before) => unchanged(campaign.equipment, before, START));
  }, [campaign]);
  const ofSet = useQuery({ ...queries.set(id), enabled: kind === "set" });
  const robot = kind === "set" ? (ofSet.data?.robot_id ?? "") : id;
  const ofRobot = useQuery({ ...queries.robot(robot), enabled: robot !== "" });
  const joints = ofRobot.data?.joints.map(({ name }) => name) ?? [];
  const [robots, sets] = [useRobotChoices(kind === "robot" ? id : ""), useSetChoices(kind === "set" ? id : "")];
  const terms = step ? OF_STEP_TERMS : EQUIPMENT;
  const form = { of: "PlanRequest", value: asked, change, terms: { ...terms, joints } };
  const equipment = campaign === undefined ? <Busy /> : <Equipment {...form} />;
  const isDescribed = useDescribed();
  const isRobotKnown = id === "" || isKnown(ofRobot) || ofSet.problem !== null;
  const isRunKnown = after === null || isKnown(ofRun);
  const areChoicesKnown = robots.known && sets.known;
  return (
    <Form
      action={start}
      look="card form"
      known={isDescribed && areChoicesKnown && isRobotKnown && isRunKnown && campaign !== undefined}
    >
      <p>{words.intro}</p>
      <SearchedSelect
        label={words.subject}
        search={
          (robots.search ?? sets.search) && {
            q: robots.search?.q ?? sets.search?.q ?? "",
            find: (q) => [robots, sets].forEach(({ search }) => search?.find(q)),
          }
        }
        known={areChoicesKnown}
        value={subject}
        change={pick}
        options={[
          { value: "", label: words.pick },
          ...robots.options.map(({ value, label }) => ({
            value: `robot:${value}`,
            label: `${label} (${words.robotGroup})`,
          })),
          ...sets.options.map(({ value, label }) => ({ value: `set:${value}`, label: `${label} (${words.setGroup})` })),
        ]}
      />
      {kind !== "set" && <SchemaFields {...form} show={["weight_step"]} />}
      <SchemaFields {...form} show={["readings"]} />
      {kind === "set" ? (
        <>
          <p class="soft">{words.fromCampaign}</p>
          {left.length + causes.length > 0 && <p class="note">{words.asInRun(left, causes)}</p>}
          <details>
            <summary>{words.more}</summary>
            <div class="card form">{equipment}</div>
          </details>
        </>
      ) : step ? (
        <SchemaFields {...form} show={["load_point"]} />
      ) : (
        equipment
      )}
      {joints.length > 0 && <SchemaFields {...form} show={["joints"]} />}
      {id && !ready && <p class="soft">{step ? words.stepNotReady : words.notReady}</p>}
      <ActionButton look="primary big" action={start} disabled={!id || unread !== null || !ready} going={words.going}>
        {words.go}
      </ActionButton>
    </Form>
  );
}

export const Equipment = (form: { of: string; value: Fields; change: (part: Fields) => void; terms: Terms }) => (
  <SchemaFields {...form} show={["load", "targets", "load_point", "sigma", "tracker", "surroundings"]} />
);

/** The newest run of a set, if there is one: the reasons of a plan that goes on from the set are said there. */
async function newestRun(set: string): Promise<Run | null> {
  const found = await ask(queries.runs({ measurement_set_id: set, state: "succeeded", limit: 1 }));
  return found.items[0] ? ask(queries.run(found.items[0].id)) : null;
}

export function PlanView({ id }: { id: string }) {
  return (
    <JobPage
      collection="plans"
      id={id}
      kind={words.kind}
      load={async (signal) => {
        const plan = await api.plans.one(id, signal);
        const setId = plan.request.measurement_set_id;
        const base = setId ? await ask(queries.set(setId)) : null;
        const robot = await ask(queries.robot(base?.robot_id ?? plan.request.robot_id ?? ""));
        const run = setId && plan.result?.assessment ? await newestRun(setId) : null;
        return { job: plan, base, robot, run, subject: base?.name ?? robot.name };
      }}
      head={({ job, base, robot, run, subject }) => ({
        name: words.title(subject),
        title: <Name>{subject}</Name>,
        list: "#/plans",
        run,
        about: <NameLink to={base ? ["sets", base.id] : ["robots", robot.id]}>{subject}</NameLink>,
        first:
          job.result && job.request.weight_step ? (
            <LinkButton look="primary" href={link(["gearboxes"], { plan: id })}>
              {gearboxWords.reading.begin}
            </LinkButton>
          ) : (
            job.result && (
              <>
                <LinkButton look="primary" href={link(["measure"], { plan: id })}>
                  {measureWords.title}
                </LinkButton>
                <Button
                  onClick={() => {
                    const campaign = toFillIn(job, robot, base);
                    saveJson(campaign, fileName(`${subject} planned`, "json"));
                  }}
                >
                  {words.fillIn}
                </Button>
              </>
            )
          ),
        actions: job.result && <Download href={api.jobs.file(id, "readings.csv")}>{words.csv}</Download>,
      })}
    >
      {(result, { robot }) => (
        <>
          <Postures result={result} robot={robot} />
          <JobLines collection="plans" id={id} />
          <JobTables collection="plans" id={id} to={1} />
        </>
      )}
    </JobPage>
  );
}
