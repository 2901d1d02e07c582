/** Gearboxes: where a weight step starts, and the gearboxes that it determines. */
import { useEffect, useState } from "preact/hooks";
import { api } from "../../api/calls";
import type { GearboxRequest, GearboxResult, RobotDocument } from "../../api/types";
import { ActionButton, Facts, Head, LinkButton, lazy, Name, ProblemNote } from "../../components/basics";
import { RobotSelect } from "../../components/choosers";
import { Estimate } from "../../components/estimate";
import { JobLines, JobPage, JobTables, VerdictCard } from "../../components/job_page";
import { DropZone, SchemaFields, type Terms } from "../../components/schema_form";

import { contentKey, type Fields, isFields, listOf, parsed } from "../../lib/json";
import { shownWithInterval, unitOf } from "../../lib/stiffness";
import { link, useAction } from "../../state/action";
import { FROM_FILE, sourceOf } from "../../state/choices";
import { recalled, remembered } from "../../state/kept";
import { useSettings } from "../../state/session";
import { text } from "../../words";
import { takeHanded } from "../readings/begun";
import { Refused } from "../readings/flow";
import { RobotTabs } from "../robots/view";
import { JobList } from "../runs/view";
import { KEPT } from "./step";
import { gearboxWords as words } from "./words";

const StepReading = lazy(async () => (await import("./reading")).StepReading);

export function GearboxView({ id }: { id: string }) {
  return (
    <JobPage
      collection="gearboxes"
      id={id}
      kind={words.title}
      load={async (signal) => ({ job: await api.gearboxes.one(id, signal) })}
      head={({ job }) => ({ name: job.name, list: "#/gearboxes" })}
    >
      {(result) => (
        <>
          <VerdictCard assessment={result.assessment} context={null} sentences={words.verdicts} />
          <Gearboxes result={result} />
          <JobLines collection="gearboxes" id={id} />
          <JobTables collection="gearboxes" id={id} from={1} />
        </>
      )}
    </JobPage>
  );
}

/** Each gearbox with its interval, or why it has no number. */
function Gearboxes({ result }: { result: GearboxResult }) {
  const { unit } = useSettings();
  const unusable = result.assessment.verdict === "do_not_use";
  return (
    <section class="card" aria-labelledby="gearboxes">
      <h2 id="gearboxes">{words.result}</h2>
      <Facts
        facts={result.gearboxes.map(({ joint, stiffness, stiffness_interval: interval, reason }) => ({
          label: <Name>{joint}</Name>,
          value:
            stiffness === null ? (
              <span class="soft">{reason}</span>
            ) : (
              <Estimate
                of={{ ...shownWithInterval(stiffness, interval, unit, "revolute"), unusable }}
                unit={unitOf(unit).label}
              />
            ),
        }))}
      />
    </section>
  );
}

/** A weight step in a file, with what the page tells of it. */
interface Step {
  logs: number;
  request: Record<string, unknown>;
  robot: RobotDocument | null;
  robotId: string;
  joints: string[];
  postures: number;
  mass: string | null; // null if the file states no load
}

function stepOf(content: string): Step | null {
  const document = parsed(content);
  if (!isFields(document)) return null;
  const { robot, robot_id: robotId, ...request } = document;
  const read = isFields(request["motion"]) ? logsOf(request["motion"]) : posturesOf(request);
  if (read === null || read.joints.length === 0) return null;
  return {
    ...read,
    request,
    robot: isFields(robot) ? (robot as unknown as RobotDocument) : null,
    robotId: typeof robotId === "string" ? robotId : "",
  };
}

type Read = Pick<Step, "joints" | "postures" | "logs" | "mass">;

/** Readings at rest, without and with a load. */
function posturesOf(request: Record<string, unknown>): Read | null {
  const load = request["load"];
  if (!isFields(load)) return null;
  const postures = listOf(request["observations"]);
  const readings = postures.flatMap((posture) => listOf(posture["encoder_readings"]));
  const joints = [...new Set(readings.map(({ joint }) => String(joint)))];
  return { joints, postures: postures.length, logs: 0, mass: massOf(load) };
}

/** Logs of a motion. */
function logsOf(motion: Record<string, unknown>): Read | null {
  const payload = motion["payload"];
  if (!isFields(payload)) return null;
  const logs = listOf(motion["logs"]);
  const names = logs.flatMap(({ link }) => (isFields(link) ? Object.keys(link) : []));
  return { joints: [...new Set(names)], postures: 0, logs: logs.length, mass: massOf(payload) };
}

const massOf = (load: Record<string, unknown>) => `${String(load["mass"] ?? "?")} kg`;

/** A weight step in a table, whose load is yet to be stated. */
async function stepOfTable(file: File): Promise<Step | null> {
  const { weight_step: read } = await api.importFiles([file]);
  if (!read) return null;
  const joints = read.observations.flatMap((posture) => posture.encoder_readings.map(({ joint }) => joint));
  return {
    joints: [...new Set(joints)],
    postures: read.observations.length,
    logs: 0,
    mass: null,
    request: { ...read },
    robot: null,
    robotId: "",
  };
}

const isTable = (file: File) => !file.name.toLowerCase().endsWith(".json");

type Opened = { name: string; step: Step | null };

/** Where gearboxes begin: by the weight step of a plan, or by a file. */
export function GearboxesView({ query }: { query: URLSearchParams }) {
  const plan = query.get("plan");
  return plan === null ? <FromFile /> : <StepReading key={plan} plan={plan} />;
}

/** Weight steps of which this device keeps readings: the plan's id, and the robot's name. */
function begunSteps(): { plan: string; robot: string }[] {
  return remembered(KEPT).map((name) => {
    const draft = recalled(name);
    const robot = isFields(draft) ? String(draft["robot"] ?? "") : "";
    return { plan: name.slice(KEPT.length), robot };
  });
}

function FromFile() {
  const [opened, setOpened] = useState<Opened | null>(null);
  const take = useAction(async (file: File) => {
    const step = isTable(file) ? await stepOfTable(file) : stepOf(await file.text());
    setOpened({ name: file.name, step });
  });
  useEffect(() => {
    const handed = takeHanded();
    if (handed) take.run(handed);
  }, []);
  return (
    <>
      <Head
        plain={words.title}
        first={<LinkButton href={link(["plans"], { step: "1" })}>{words.planStep}</LinkButton>}
      />
      <RobotTabs current="gearboxes" />
      <p>{words.intro}</p>
      {begunSteps().map(({ plan, robot }) => (
        <p>
          <a href={link(["gearboxes"], { plan })}>
            {words.goOn} <Name>{robot}</Name>
          </a>
        </p>
      ))}
      <div class="flow">
        <section class="card" aria-labelledby="step-file">
          <h2 id="step-file">{words.readings}</h2>
          <DropZone
            title={words.drop}
            hint={words.dropHint}
            accept=".json,application/json,.csv,.txt,.xlsx,.parquet"
            compact={opened !== null}
            button={opened ? text.files.another : text.files.choose}
            take={(file) => void take.run(file)}
          />
          {take.problem && <ProblemNote problem={take.problem} />}
          {opened && !opened.step && <Refused file={opened.name} why={words.notReadings} />}
          {opened?.step && <Understood {...opened.step} />}
        </section>
        {opened?.step && <Start key={opened.name} step={opened.step} />}
      </div>
      <JobList collection="gearboxes" />
    </>
  );
}

const Understood = ({ joints, postures, logs, mass }: Step) => (
  <Facts
    facts={[
      { label: words.joints, value: <Name>{joints.join(", ")}</Name> },
      logs > 0 ? { label: words.logs, value: String(logs) } : { label: words.postures, value: String(postures) },
      ...(mass === null ? [] : [{ label: logs > 0 ? words.payload : words.load, value: mass }]),
    ]}
  />
);

/** Units of a load: lengths as in the table. */
const unitsOfLoad = ({ units }: Record<string, unknown>): NonNullable<Terms["units"]> => {
  const length = isFields(units) ? String(units["length"]) : text.units.mm;
  return { mass: ["kg", 1], mass_uncertainty: ["kg", 1], point: [length, 1], point_uncertainty: [length, 1] };
};

/** The robot, the load of a table, and the button. */
function Start({ step }: { step: Step }) {
  const [chosen, setChosen] = useState(step.robot ? FROM_FILE : step.robotId);
  const [load, setLoad] = useState<Fields>({});
  const source = sourceOf(chosen, step.robot);
  const asksLoad = step.mass === null;
  const ready = source && (!asksLoad || (load["mass"] && load["point"]));
  const start = useAction(async () => {
    const request = { ...step.request, ...(asksLoad ? { load } : {}), ...source } as unknown as GearboxRequest;
    const made = await api.gearboxes.add(request, contentKey("gearbox", request));
    return link(["gearboxes", made.id]);
  }, "gearbox");
  return (
    <section class="card" aria-labelledby="robot">
      <h2 id="robot">{words.robot}</h2>
      <RobotSelect
        label={words.robot}
        value={chosen}
        change={setChosen}
        help={words.robotHint}
        none={words.pickRobot}
        ofFile={step.robot}
      />
      {asksLoad && (
        <SchemaFields
          of="HungLoad"
          show={["mass", "mass_uncertainty", "point", "point_uncertainty"]}
          value={load}
          change={setLoad}
          terms={{ labels: words.ofLoad, units: unitsOfLoad(step.request) }}
        />
      )}
      <ActionButton look="primary big" action={start} disabled={!ready} going={text.start.going}>
        {words.identify}
      </ActionButton>
    </section>
  );
}
