/** Geometries: where they start, and one with its axes, its evidence, and a robot made of it. */
import type { Geometry, GeometryResult, RobotDocument } from "../../api/types";
import { JobLines, JobTables, JobPage, VerdictCard } from "../../components/job_page";
import { useState, useEffect } from "preact/hooks";
import { api } from "../../api/calls";
import { Arm } from "../../scene/view";
import { ActionButton, Facts, Title } from "../../components/basics";
import { TextField } from "../../components/fields";
import { useAction, link } from "../../state/action";
import { RobotSelect } from "../../components/choosers";
import { FROM_FILE, sourceOf } from "../../state/choices";
import { DropZone } from "../../components/schema_form";
import { DataTable } from "../../components/table";
import { fixed } from "../../lib/format";
import { contentKey } from "../../lib/json";
import { type ReadingFacts, type Readings, readingsOf } from "../../lib/campaign";
import { takeHanded } from "../readings/begun";
import { useTypedValue } from "../../state/session";
import { text } from "../../words";
import { Refused } from "../readings/flow";
import { JobList } from "../runs/view";
import { RobotTabs } from "../robots/view";
import { geometryWords } from "./words";
import { robotWords } from "../robots/words";

const words = geometryWords;

export function GeometryView({ id }: { id: string }) {
  return (
    <JobPage
      collection="geometries"
      id={id}
      kind={words.title}
      load={async (signal) => ({ job: await api.geometries.one(id, signal) })}
      head={({ job }) => ({ name: job.name, list: "#/geometries" })}
    >
      {(result, { job }) => <Found geometry={job} result={result} />}
    </JobPage>
  );
}

function Found({ geometry, result }: { geometry: Geometry; result: GeometryResult }) {
  const source = { robot: result.robot as RobotDocument };
  return (
    <>
      <VerdictCard assessment={result.assessment} context={null} sentences={words.verdicts} />
      <div class="flow">
        <section class="card">
          <h2>{words.axesInScene}</h2>
          <Arm source={source} start={null} />
        </section>
        <section class="card">
          <h2>{words.result}</h2>
          <JobLines collection="geometries" id={geometry.id} />
          <SaveAsRobot geometry={geometry} result={result} />
        </section>
      </div>
      {result.links.length === 0 && <p class="soft">{words.noLinks}</p>}
      {result.links.length > 0 && <JobTables collection="geometries" id={geometry.id} from={-1} />}
      <JobTables collection="geometries" id={geometry.id} to={result.links.length > 0 ? -1 : undefined} />
    </>
  );
}

function SaveAsRobot({ geometry, result }: { geometry: Geometry; result: GeometryResult }) {
  const [name, setName] = useTypedValue(`geometry/${geometry.id}`, words.asMeasured(geometry.name));
  const save = useAction(async () => {
    const document: RobotDocument = { name, model: { format: "geometry", geometry_id: geometry.id } };
    const robot = await api.robots.add(document, `robot-${geometry.id}-${name}`.slice(0, 200));
    return link(["robots", robot.id]);
  });
  return (
    <>
      <div class="row">
        <TextField label={words.saveName} value={name} maxLength={200} change={setName} />
        <ActionButton look="primary" action={save} disabled={!name.trim()} going={robotWords.saving}>
          {words.save}
        </ActionButton>
      </div>
      {result.assessment.verdict === "do_not_use" && <p class="note warn">{words.doubtful}</p>}
    </>
  );
}

type Opened = { name: string; readings: Readings | null };

export function GeometriesView() {
  const [opened, setOpened] = useState<Opened | null>(null);
  const take = async (file: File) => setOpened({ name: file.name, readings: readingsOf(await file.text()) });
  useEffect(() => {
    const file = takeHanded();
    if (file) void take(file);
  }, []);
  return (
    <>
      <Title plain={words.title}>{words.title}</Title>
      <RobotTabs current="geometries" />
      <p>{words.intro}</p>
      <div class="flow">
        <section class="card" aria-labelledby="sweeps-file">
          <h2 id="sweeps-file">{words.readings}</h2>
          <DropZone
            title={words.drop}
            hint={words.dropHint}
            accept=".json,application/json"
            compact={opened !== null}
            button={opened ? text.files.another : text.files.choose}
            take={(file) => void take(file)}
          />
          {opened?.readings === null && <Refused file={opened.name} why={words.notReadings} />}
          {opened?.readings && <Understood name={opened.name} facts={opened.readings.facts} />}
        </section>
        {opened?.readings && <Start key={opened.name} readings={opened.readings} />}
      </div>
      <JobList collection="geometries" />
    </>
  );
}

function Understood({ name, facts }: { name: string; facts: ReadingFacts }) {
  return (
    <>
      <h3 class="file">
        <bdi>{facts.name ?? name}</bdi>
      </h3>
      <Facts
        facts={[
          { label: text.files.facts.units, value: facts.units ?? text.files.notSaid },
          { label: text.files.facts.targets, value: facts.targets.join(", ") },
          ...(facts.poses === null ? [] : [{ label: words.poses, value: String(facts.poses) }]),
        ]}
      />
      {facts.sweeps.length > 0 && (
        <DataTable
          caption={words.readings}
          table={{
            columns: [
              text.run.joint,
              { title: words.positions, show: (value) => fixed(value, 0) },
              { title: words.arc, unit: text.units.deg, show: (value) => fixed(value, 0) },
            ],
            rows: facts.sweeps.map(({ joint, positions, arc }) => [joint, positions, arc]),
          }}
        />
      )}
    </>
  );
}

/** The nominal model, and the button. */
function Start({ readings }: { readings: Readings }) {
  const [chosen, setChosen] = useState(readings.robot ? FROM_FILE : (readings.robotId ?? ""));
  const needed = readings.facts.poses !== null;
  const source = sourceOf(chosen, readings.robot);
  const start = useAction(async () => {
    const request = { ...readings.request, ...source };
    const made = await api.geometries.add(request, contentKey("geometry", request));
    return link(["geometries", made.id]);
  }, "geometry");
  return (
    <section class="card" aria-labelledby="nominal">
      <h2 id="nominal">{words.nominal}</h2>
      <RobotSelect
        label={words.nominal}
        value={chosen}
        change={setChosen}
        help={words.nominalHint}
        none={needed ? words.pickNominal : words.noNominal}
        ofFile={readings.robot}
      />
      {source && <Arm key={chosen} source={source} start={null} sliders={false} />}
      <ActionButton look="primary big" action={start} disabled={needed && !source} going={text.start.going}>
        {words.identify}
      </ActionButton>
    </section>
  );
}
