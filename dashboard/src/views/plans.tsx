/** Where plans start: a robot to begin with or a set to go on with, targets, tracker, loads, count. */
import { useEffect, useState } from "preact/hooks";
import { api } from "../api/client";
import { ActionButton, Show, Title, Toggle } from "../components/basics";
import { Fields, Select } from "../components/fields";
import { type FieldOf, FormFields } from "../components/form";
import { type Asked, equipmentOf, optionsOf } from "../lib/planned";
import { freshKey } from "../lib/hash";
import { asking, useAction } from "../state/action";
import { useLoad, valueOf } from "../state/load";
import { type Names, useNames } from "../state/names";
import { useDraft } from "../state/kept";
import { link } from "../state/router";
import { storedRobot, storedSet } from "../state/stored";
import { text } from "../i18n";
import { NoRobots } from "./robots";
import { JobList } from "./job_list";

const words = text.plan;

export const START: Asked = {
  targets: "",
  loadPoint: "",
  station: "",
  sigma: "20",
  kind: "dead_weight",
  force: "",
  anchors: "",
  floor: "",
  readings: "20",
  joints: [],
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
              <Form names={known} given={given} />
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

function Form({ names, given }: { names: Names; given: string }) {
  const [subject, setSubject] = useState(given);
  const [asked, change] = useDraft<Asked>(`plan/${given}`, given.startsWith("set:") ? { ...START, sigma: "" } : START);
  const [kind, id = ""] = subject.split(":", 2);
  const options = optionsOf(asked);
  const ready = kind === "set" || Boolean(asked.force.trim() && asked.targets.trim());
  const start = useAction(async () => {
    const whose = kind === "set" ? { measurement_set_id: id } : { robot_id: id };
    const plan = await asking((accepted) =>
      api.plans.add({ ...whose, ...(options as object), ...accepted }, freshKey("plan")),
    );
    return link(["plans", plan.id]);
  }, "plan");
  const pick = (value: string) => {
    setSubject(value);
    change({ joints: [], sigma: value.startsWith("set:") ? "" : START.sigma });
  };
  const earlier = kind === "robot" ? names.sets.find((set) => set.robot_id === id)?.id : undefined;
  const campaign = valueOf(useLoad(async () => (earlier ? await storedSet(earlier) : null), [earlier]));
  useEffect(() => {
    if (!campaign) return;
    const known = Object.entries(equipmentOf(campaign)) as [keyof Asked, string][];
    change((before) => Object.fromEntries(known.filter(([name]) => before[name] === START[name])));
  }, [campaign]);
  const equipment = <Equipment asked={asked} change={change} />;
  return (
    <Fields action={start} look="card form">
      <p>{words.intro}</p>
      <Select
        label={words.subject}
        value={subject}
        change={pick}
        options={[
          { value: "", label: words.pick },
          ...names.robots.map((robot) => ({
            value: `robot:${robot.id}`,
            label: `${names.robot(robot.id)} (${words.robotGroup})`,
          })),
          ...names.sets.map((set) => ({ value: `set:${set.id}`, label: `${names.set(set.id)} (${words.setGroup})` })),
        ]}
      />
      <FormFields fields={READINGS} values={asked} change={change} />
      {kind === "set" ? (
        <>
          <p class="soft">{words.fromCampaign}</p>
          <details>
            <summary>{words.more}</summary>
            <div class="card form">{equipment}</div>
          </details>
        </>
      ) : (
        equipment
      )}
      <Joints
        key={subject}
        robot={kind === "set" ? (names.sets.find((set) => set.id === id)?.robot_id ?? "") : id}
        chosen={asked.joints}
        change={(joints) => change({ joints })}
      />
      {typeof options === "string" && <p class="note warn">{words.unread(options)}</p>}
      {id && !ready && <p class="soft">{words.notReady}</p>}
      <ActionButton
        look="primary big"
        action={start}
        disabled={!id || typeof options === "string" || !ready}
        going={words.going}
      >
        {words.go}
      </ActionButton>
    </Fields>
  );
}

const TARGETS = "P1 147 55 50\nP2 -137 87 85\nP3 -7 -140 120";

/** What is measured with; the places of the fields in the request. */
const equipmentFields = (kind: Asked["kind"]): FieldOf<Asked>[] => [
  { name: "kind", kind: "select", label: words.load, options: words.kinds },
  { name: "force", label: words.force, path: "load", placeholder: "900", inputMode: "decimal" },
  { name: "anchors", label: words.anchors, path: "load", placeholder: "3000 0 0", lines: 4, asked: kind === "cable" },
  { name: "targets", label: words.targets, path: "targets", placeholder: TARGETS, lines: 4 },
  { name: "loadPoint", label: words.loadPoint, path: "load_point", placeholder: "-60 20 180" },
  { name: "sigma", label: words.sigma, path: "sigma", inputMode: "decimal" },
  { name: "station", label: words.station, path: "tracker", placeholder: "4000 0 1500" },
  { name: "floor", label: words.floor, path: "surroundings", inputMode: "decimal" },
];

const READINGS: FieldOf<Asked>[] = [
  { name: "readings", label: words.readings, path: "readings", inputMode: "decimal" },
];

export const Equipment = ({ asked, change }: { asked: Asked; change: (part: Partial<Asked>) => void }) => (
  <div class="map-fields">
    <FormFields fields={equipmentFields(asked.kind)} values={asked} change={change} />
  </div>
);

/** None chosen means all, as the service has it. */
function Joints({ robot, chosen, change }: { robot: string; chosen: string[]; change: (joints: string[]) => void }) {
  const loaded = valueOf(useLoad(async () => (robot ? await storedRobot(robot) : null), [robot]));
  if (!loaded) return null;
  const all = loaded.joints.map((joint) => joint.name);
  const wanted = chosen.length > 0 ? chosen : all;
  return (
    <fieldset class="choice">
      <legend>{words.joints}</legend>
      <div class="toggles">
        {all.map((name) => (
          <Toggle
            label={name}
            checked={wanted.includes(name)}
            change={(on) => {
              const next = all.filter((each) => (each === name ? on : wanted.includes(each)));
              change(next.length === all.length ? [] : next);
            }}
          />
        ))}
      </div>
      <small class="soft">{words.jointsHint}</small>
    </fieldset>
  );
}
