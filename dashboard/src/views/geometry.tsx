/** A geometry: the axes drawn, the identified model beside the nominal one, findings, and a robot made of it. */
import type { Geometry, GeometryResult, RobotDocument, RobotRequest } from "../api/types";
import { JobLines, JobTables } from "../components/job_tables";
import { later } from "../i18n/later";
import { useMemo, useState } from "preact/hooks";
import { api } from "../api/client";
import { Arm } from "../components/arm";
import { ActionButton } from "../components/basics";
import { TextField } from "../components/fields";
import { JobPage } from "../components/job_page";
import { useAction } from "../state/action";
import { namesChanged } from "../state/names";
import { link } from "../state/router";
import { VerdictCard } from "./verdict_card";

const words = later.geometry;

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
  const source = useMemo(() => ({ robot: result.robot as RobotDocument }), [result]);
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
  const [name, setName] = useState(words.asMeasured(geometry.name));
  const save = useAction(async () => {
    const document: RobotRequest = { name, model: { format: "geometry", geometry_id: geometry.id } };
    const robot = await api.robots.add(document, `robot-${geometry.id}-${name}`.slice(0, 200));
    namesChanged();
    return link(["robots", robot.id]);
  });
  return (
    <>
      <div class="row">
        <TextField label={words.saveName} value={name} maxLength={200} change={setName} />
        <ActionButton look="primary" action={save} disabled={!name.trim()} going={words.saving}>
          {words.save}
        </ActionButton>
      </div>
      {result.assessment.verdict === "do_not_use" && <p class="note warn">{words.doubtful}</p>}
    </>
  );
}
