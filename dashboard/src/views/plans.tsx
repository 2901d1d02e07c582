/** Where plans start: a robot to begin with or a set to go on with, targets, tracker, loads, count. */
import { useEffect, useState } from "preact/hooks";
import { api } from "../api/client";
import { ActionButton, Show, Title } from "../components/basics";
import { Fields as Form, Select } from "../components/fields";
import { SchemaFields, type Terms } from "../components/schema_form";
import { freshKey } from "../lib/hash";
import { type Fields, unreadIn } from "../lib/json";
import { equipmentOf, unchanged } from "../lib/planned";
import { asking, useAction } from "../state/action";
import { useDraft } from "../state/kept";
import { useLoad, valueOf } from "../state/load";
import { type Names, useNames, storedSet } from "../state/names";
import { link } from "../state/router";
import { text } from "../i18n";
import { later } from "../i18n/later";
import { JobList } from "./job_list";
import { NoRobots } from "./robots";

const words = later.plan;

export const START: Fields = { sigma: 2e-5 };
const WIDTH = { constant: 2e-5, per_distance: 0 };

/** What is measured with, in the units of a workshop. */
export const EQUIPMENT: Terms = {
  labels: words.labels,
  seeds: { tracker: { range: WIDTH, transverse: WIDTH } },
  units: {
    sigma: [text.units.micrometre, 1e-6],
    "tracker.range.constant": [text.units.micrometre, 1e-6],
    "tracker.range.per_distance": [`${text.units.micrometre}/m`, 1e-6],
    "tracker.transverse.constant": [text.units.micrometre, 1e-6],
    "tracker.transverse.per_distance": [`${text.units.micrometre}/m`, 1e-6],
  },
  hidden: [
    ...["inside", "obstacles", "link_radius", "facing", "acceptance"].map((name) => `surroundings.${name}`),
    ...["gravity", "balancers"].map((name) => `load.${name}`),
  ],
};

export function PlansView({ query }: { query: URLSearchParams }) {
  const names = useNames();
  const given = query.get("set") ? `set:${query.get("set")}` : query.get("robot") ? `robot:${query.get("robot")}` : "";
  return (
    <>
      <Title plain={words.begin}>{words.begin}</Title>
      <Show of={names}>
        {(known) =>
          known.robots.length === 0 ? (
            <NoRobots />
          ) : (
            <>
              <Begin names={known} given={given} after={query.get("run")} />
              <JobList
                collection="plans"
                title={text.earlier.plans}
                names={known}
                row={({ measurement_set_id: set, robot_id: robot }) => ({
                  name: set ? known.set(set) : known.robot(robot),
                })}
              />
            </>
          )
        }
      </Show>
    </>
  );
}

/** `after`: the run of the campaign so far, whose causes and omitted readings hold on. */
function Begin({ names, given, after }: { names: Names; given: string; after: string | null }) {
  const [subject, setSubject] = useState(given);
  const [asked, change] = useDraft<Fields>(`plan/${given}`, given.startsWith("set:") ? {} : START);
  const [kind, id = ""] = subject.split(":", 2);
  const unread = unreadIn(asked);
  const ready = kind === "set" || Boolean(asked["load"] && asked["targets"]);
  const run = valueOf(useLoad(async (signal) => (after ? api.runs.one(after, signal) : null), [after]));
  const so = run?.request.measurement_set_id === id ? run?.request : null;
  const start = useAction(async () => {
    const whose = kind === "set" ? { measurement_set_id: id } : { robot_id: id };
    const held = so ? { causes: so.causes, leave_out: so.leave_out } : {};
    const stated = Object.fromEntries(Object.entries(asked).filter(([, value]) => value !== null));
    const plan = await asking((accepted) =>
      api.plans.add({ ...whose, ...held, ...stated, ...accepted }, freshKey("plan")),
    );
    return link(["plans", plan.id]);
  }, "plan");
  const pick = (value: string) => {
    setSubject(value);
    change({ joints: [], sigma: value.startsWith("set:") ? null : START["sigma"] });
  };
  const earlier = kind === "robot" ? names.sets.find((set) => set.robot_id === id)?.id : undefined;
  const campaign = valueOf(useLoad(async () => (earlier ? await storedSet(earlier) : null), [earlier]));
  useEffect(() => {
    if (campaign) change((before) => unchanged(equipmentOf(campaign), before, START));
  }, [campaign]);
  const robot = kind === "set" ? names.sets.find((set) => set.id === id)?.robot_id : id;
  const joints = names.robots.find((one) => one.id === robot)?.joints.map(({ name }) => name) ?? [];
  const form = { of: "PlanRequest-Input", value: asked, change, terms: { ...EQUIPMENT, joints } };
  const equipment = <Equipment {...form} />;
  return (
    <Form action={start} look="card form">
      <p>{words.intro}</p>
      <Select
        label={words.subject}
        value={subject}
        change={pick}
        options={[
          { value: "", label: words.pick },
          ...names.robots.map((one) => ({
            value: `robot:${one.id}`,
            label: `${names.robot(one.id)} (${words.robotGroup})`,
          })),
          ...names.sets.map((set) => ({ value: `set:${set.id}`, label: `${names.set(set.id)} (${words.setGroup})` })),
        ]}
      />
      <SchemaFields {...form} show={["readings"]} />
      {kind === "set" ? (
        <>
          <p class="soft">{words.fromCampaign}</p>
          {so && so.leave_out.length + so.causes.length > 0 && (
            <p class="note">{words.asInRun(so.leave_out, so.causes)}</p>
          )}
          <details>
            <summary>{words.more}</summary>
            <div class="card form">{equipment}</div>
          </details>
        </>
      ) : (
        equipment
      )}
      {joints.length > 0 && <SchemaFields {...form} show={["joints"]} />}
      {id && !ready && <p class="soft">{words.notReady}</p>}
      <ActionButton look="primary big" action={start} disabled={!id || unread !== null || !ready} going={words.going}>
        {words.go}
      </ActionButton>
    </Form>
  );
}

export const Equipment = (form: { of: string; value: Fields; change: (part: Fields) => void; terms: Terms }) => (
  <SchemaFields {...form} show={["load", "targets", "load_point", "sigma", "tracker", "surroundings"]} />
);
