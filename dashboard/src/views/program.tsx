/** A compensated program: the path over the robot by its deflection, before and after, the worst points, the files. */
import { useMemo, useState } from "preact/hooks";
import { api } from "../api/client";
import type { Program } from "../api/types";
import { Download, Busy, Choice } from "../components/basics";
import { Handle } from "../components/fields";
import { JobPage, JobLines, JobTables } from "../components/job_page";
import { RampLegend, share } from "./map";
import { type PathPoint, pointsOf, thinned } from "../lib/map";
import { extent } from "../lib/format";
import { ArmView, roomOf } from "../scene/view";
import { subtract, type Vector } from "../lib/vector";
import { useKinematics } from "../state/load";
import { link } from "../state/action";
import { text } from "../i18n";
import { later } from "../i18n/later";
import { contextOfEnded, type RunContext } from "./run_context";

const words = later.program;
const MOST_DRAWN = 3_000;
const FINEST = 150; // points side by side along the path: more are drawn over each other
const COARSEST = 25;

interface Loaded extends RunContext {
  job: Program;
  points: PathPoint[];
}

async function load(id: string, signal: AbortSignal): Promise<Loaded> {
  const job = await api.programs.one(id, signal);
  const points = job.result ? pointsOf(await api.programPoints(id)) : [];
  return { job, points, ...(await contextOfEnded(job.request.run_id)) };
}

export function ProgramView({ id }: { id: string }) {
  return (
    <JobPage
      collection="programs"
      id={id}
      kind={words.kind}
      load={(signal) => load(id, signal)}
      head={({ job, run }) => ({
        name: job.request.files[0]?.name ?? words.kind,
        list: link(["runs", run.id]),
        about: <a href={link(["runs", run.id])}>{text.run.kind}</a>,
        first: job.result?.files.map((file) => (
          <Download look="primary" href={api.programFile(id, file.name)}>
            {words.download(file.name)}
          </Download>
        )),
        actions: job.result && <Download href={api.jobs.file(id, "points.csv")}>{words.table}</Download>,
      })}
    >
      {(_, loaded) => (
        <>
          <JobLines collection="programs" id={loaded.job.id} />
          <Scene loaded={loaded} />
          <JobTables collection="programs" id={loaded.job.id} />
        </>
      )}
    </JobPage>
  );
}

function Scene({ loaded: { points, robot } }: { loaded: Loaded }) {
  const [when, setWhen] = useState<"before" | "after">("before");
  const [chosen, setChosen] = useState(0);
  const drawn = useMemo(() => thinned(points, MOST_DRAWN), [points]);
  const point = points[chosen];
  const { kinematics } = useKinematics(point ? { robot_id: robot.id } : null, point ? [point.joints] : []);
  const posture = kinematics?.postures[0];
  const size = useMemo(
    () => lengthOf(drawn.map((one) => one.place)) / Math.min(FINEST, Math.max(COARSEST, drawn.length)),
    [drawn],
  );
  const greatest = useMemo(
    () => points.reduce((most, one) => (one.deflection > most ? one.deflection : most), 0),
    [points],
  );
  const loaded = drawn.filter((one) => Number.isFinite(one.deflection));
  const cloud = {
    places: loaded.map((one) => one.place),
    shares: loaded.map((one) => share(when === "before" ? one.deflection : one.residual, [0, greatest])),
    size,
  };
  if (!posture || !point) return <Busy label={text.scene.loading} />;
  const { flange_origin: flange } = posture;
  return (
    <section class="scene">
      <div class="view">
        <ArmView
          posture={posture}
          axes={false}
          predicted={[{ from: flange, along: subtract(point.place, flange) }]}
          cloud={cloud}
          room={[...roomOf([posture]), ...drawn.map((one) => one.place)]}
          label={words.view}
        />
      </div>
      <div class="controls">
        <Choice
          label={words.colour}
          value={when}
          change={setWhen}
          options={{ before: words.beforeShort, after: words.afterShort }}
        />
        <RampLegend scale={[0, greatest]} unit={text.units.mm} label={words.off} />
        <Handle label={words.choosePoint} count={points.length} value={chosen} change={setChosen}>
          {words.point(point.number, point.line)}
        </Handle>
      </div>
    </section>
  );
}

/** Greatest length of a path along an axis, 0.1 m at least. */
function lengthOf(places: Vector[]): number {
  const ends = ([0, 1, 2] as const).map((axis) => extent(places.map((place) => place[axis])) ?? [0, 0]);
  return Math.max(0.1, ...ends.map(([low = 0, high = 0]) => high - low));
}
