/** What came of a process: the path in 3D with its deflections before and after, and the map of places of the workpiece. */
import { useMemo, useState } from "preact/hooks";
import { api } from "../../api/calls";
import { queries } from "../../api/queries";
import type { Process, ProcessResult } from "../../api/types";
import { AlongPath } from "../../charts/along_path";
import { Busy, Choice, Download, Facts, NameLink, useWidth } from "../../components/basics";
import { Estimate } from "../../components/estimate";
import { Handle } from "../../components/fields";
import { boundedLength, type ShownEstimate, shownEstimate } from "../../lib/estimate";
import { JobLines, JobPage, JobTables } from "../../components/job_page";
import { extent, fixed, percent, significant } from "../../lib/format";
import * as maps from "../../lib/map";
import { type ProcessPoint, processPointsOf, type SearchedPlace, searchedPlacesOf, type Stage } from "./process";
import { subtract } from "../../lib/vector";
import { ArmView, roomOf } from "../../scene/view";
import { link } from "../../state/action";
import { useKinematics } from "../../state/kinematics";
import { ask } from "../../state/query";
import { text } from "../../words";
import { processWords as words } from "./words";
import { RampLegend } from "../../charts/ramp";
import { lengthOf, share, SliceChart } from "../use/results";
import { contextOfEnded } from "../../state/run_context";
import { sceneWords } from "../../scene/words";
import { sourceWords } from "../../components/words";
import { programWords } from "../use/words";

const { mm, micrometre, deg } = text.units;
const MOST_DRAWN = 3_000;
const FINEST = 150; // points side by side along the path: more are drawn over each other
const COARSEST = 25;

async function load(id: string, signal: AbortSignal) {
  const job = await api.processes.one(id, signal);
  const { run_id: measured, robot_id: unmeasured } = job.request;
  const table = (name: "points" | "turns" | "places") => ask(queries.table(id, name));
  const points = job.result ? processPointsOf(await table("points"), await table("turns")) : [];
  const places = job.result && job.request.place ? searchedPlacesOf(await table("places")) : [];
  const context = measured ? await contextOfEnded(measured) : null;
  const robot = context?.robot ?? (await ask(queries.robot(unmeasured ?? "")));
  return { job, points, places, robot, run: context?.run ?? null };
}

type Loaded = Awaited<ReturnType<typeof load>>;

export function ProcessView({ id }: { id: string }) {
  return (
    <JobPage
      collection="processes"
      id={id}
      kind={words.kind}
      load={(signal) => load(id, signal)}
      head={({ job, robot, run }) => ({
        name: (job.request.files ?? [])[0]?.name ?? words.kind,
        list: job.request.run_id ? link(["runs", job.request.run_id]) : link(["robots", robot.id]),
        run,
        about: job.request.run_id ? (
          <a href={link(["runs", job.request.run_id])}>{text.run.kind}</a>
        ) : (
          <>
            <NameLink to={["robots", robot.id]}>{robot.name}</NameLink>
            <span>{words.unmeasured}</span>
          </>
        ),
        first: job.result?.files.map((file) => (
          <Download look="primary" href={api.programFile(id, file.name)}>
            {words.download(file.name)}
          </Download>
        )),
        actions: job.result && (
          <>
            <Download href={api.jobs.file(id, "turns.csv")}>{words.turnsTable}</Download>
            {job.request.place && <Download href={api.jobs.file(id, "places.csv")}>{words.placesTable}</Download>}
          </>
        ),
      })}
    >
      {(result, loaded) => (
        <>
          <JobLines collection="processes" id={id} />
          <Along loaded={loaded} result={result} />
          {loaded.places.length > 0 && <Places loaded={loaded} result={result} />}
          <div class="wraps">
            <JobTables collection="processes" id={id} />
          </div>
        </>
      )}
    </JobPage>
  );
}

const STAGES = Object.keys(words.stages) as Stage[];
const MARKS: Record<Stage, string> = { before: "as-sent", turned: "as-chosen", left: "as-corrected" };

/** The path with the arm in 3D and its deflections in a chart, both of one chosen point. */
function Along({ loaded: { job, points, robot }, result }: { loaded: Loaded; result: ProcessResult }) {
  const stages = STAGES.filter((one) =>
    one === "left" ? job.request.correct !== false : one !== "before" || result.before !== null,
  );
  const [stage, setStage] = useState<Stage>(stages[0] ?? "turned");
  const [chosen, setChosen] = useState(0);
  const drawn = useMemo(() => maps.thinned(points, MOST_DRAWN), [points]);
  const most = extent(points.flatMap(({ before, turned }) => [before, turned]).filter(Number.isFinite))?.[1] ?? 1;
  const point = points[chosen];
  const unusable = result.assessment.verdict === "do_not_use";
  const source = sourceWords.source(
    percent(result.confidence),
    points.every((each) => each.withModelError),
  );
  return (
    <>
      <section class="scene">
        <div class="view">
          <Arm points={drawn} point={point} robot={robot.id} stage={stage} most={most} />
        </div>
        <div class="controls">
          <Choice
            label={words.colour}
            value={stage}
            change={setStage}
            options={stages.map((value) => ({ value, label: words.stages[value] }))}
          />
          <RampLegend scale={[0, most]} unit={mm} label={words.deflection} />
          {point && (
            <>
              <Handle label={words.choosePoint} count={points.length} value={chosen} change={setChosen}>
                {words.point(point.number, point.line)}
              </Handle>
              <PointFacts {...{ point, stages, unusable }} confidence={result.confidence} />
            </>
          )}
        </div>
      </section>
      <AlongPath
        title={words.along}
        along={points.map(({ along }) => along)}
        lines={stages.map((one) => ({
          mark: MARKS[one],
          label: words.stageLong[one],
          values: points.map((each) => each[one]),
        }))}
        bands={stages.map((one) => ({
          mark: MARKS[one],
          label: programWords.band(words.stageLong[one], source),
          ends: points.map(({ intervals }) => intervals[one]),
        }))}
        axes={{ along: words.alongAxis, value: mm, unit: mm, alongUnit: words.alongAxis }}
        chosen={chosen}
        choose={setChosen}
      />
    </>
  );
}

interface ArmProps {
  points: ProcessPoint[];
  point: ProcessPoint | undefined;
  robot: string;
  stage: Stage;
  most: number;
}

/** The arm at a point of the path as chosen, and the path in the colours of its deflections. */
function Arm({ points, point, robot, stage, most }: ArmProps) {
  const { kinematics } = useKinematics(point ? { robot_id: robot } : null, point ? [point.joints] : []);
  const posture = kinematics?.[0];
  if (!posture || !point) return <Busy label={sceneWords.loading} />;
  const { flange_origin: flange } = posture;
  const places = points.map(({ place }) => place);
  const loaded = points.filter((each) => Number.isFinite(each[stage]));
  return (
    <ArmView
      posture={posture}
      axes={false}
      predicted={[{ from: flange, along: subtract(point.place, flange) }]}
      cloud={{
        places: loaded.map(({ place }) => place),
        shares: loaded.map((each) => share(each[stage], [0, most])),
        size: lengthOf(places) / Math.min(FINEST, Math.max(COARSEST, points.length)),
      }}
      room={[...roomOf([posture]), ...places]}
      label={words.view}
    />
  );
}

interface PointFactsProps {
  point: ProcessPoint;
  stages: Stage[];
  confidence: number;
  unusable: boolean;
}

function PointFacts({ point, stages, confidence, unusable }: PointFactsProps) {
  const shown = (stage: Stage) => {
    const [low, high] = point.intervals[stage];
    return { ...boundedLength(1e3 * point[stage], [1e3 * low, 1e3 * high]), unusable };
  };
  return (
    <Facts
      facts={[
        Number.isFinite(point.turn) && { label: words.turnOf, value: `${fixed(point.turn, 0)}${deg}` },
        ...stages.map((stage) => ({
          label: words.stageLong[stage],
          value: <Estimate of={shown(stage)} unit={micrometre} />,
        })),
        {
          label: sourceWords.inBrackets,
          value: <span class="brackets">{sourceWords.source(percent(confidence), point.withModelError)}</span>,
        },
      ]}
    />
  );
}

/** The map of places of the workpiece, height by height; a tapped place says its numbers. */
function Places({ loaded: { job, places }, result }: { loaded: Loaded; result: ProcessResult }) {
  const grid = gridOf(job.request);
  const values = places.map(({ deflection }) => 1e6 * deflection);
  const scale = extent(values.filter(Number.isFinite)) ?? [0, 1];
  const least = values.findIndex((value) => value === scale[0]);
  const [chosen, setChosen] = useState(Math.max(0, least));
  const [box, width] = useWidth<HTMLDivElement>();
  const layer = chosen % grid[2];
  const place = places[chosen];
  return (
    <section class="card">
      <h2>{words.places}</h2>
      <p class="soft">{words.placesNote}</p>
      <RampLegend scale={scale} unit={micrometre} label={words.deflection} />
      <div ref={box}>
        {width > 0 && (
          <SliceChart
            slice={maps.sliceOf(grid, 2, layer)}
            {...{ places, values, scale, chosen, width }}
            choose={setChosen}
            label={`${words.places}. ${words.placesNote}`}
          />
        )}
      </div>
      {grid[2] > 1 && (
        <Handle label={words.places} count={grid[2]} value={layer} change={(to) => setChosen(chosen - layer + to)}>
          {words.height(fixed(1e3 * (place?.position[2] ?? 0), 0))}
        </Handle>
      )}
      {place && <PlaceFacts place={place} best={scale[0]} found={result.places[0]?.deflection} />}
    </section>
  );
}

/** The grid of places that were tried. */
const gridOf = ({ grid }: Process["request"]): [number, number, number] => [
  grid?.[0] ?? 1,
  grid?.[1] ?? 1,
  grid?.[2] ?? 1,
];

type Found = ProcessResult["places"][number]["deflection"];

interface PlaceFactsProps {
  place: SearchedPlace;
  /** Least deflection of the grid [µm]. */
  best: number;
  /** Deflection at the chosen place, in full [m]. */
  found: Found | undefined;
}

/** A deflection with its interval [µm]. */
function bandOf({ value, readings, with_model_error: whole }: Found): ShownEstimate {
  const ends = whole ?? readings;
  return shownEstimate(1e6 * value, ends && [1e6 * ends[0], 1e6 * ends[1]]);
}

function PlaceFacts({ place, best, found }: PlaceFactsProps) {
  const value = 1e6 * place.deflection;
  const position = `${place.position.map((each) => fixed(1e3 * each, 0)).join(", ")} ${mm}`;
  return (
    <div aria-live="polite">
      {place.status !== "reached" && <p class="note">{words.notReached}</p>}
      <Facts
        facts={[
          { label: words.position, value: position },
          place.status === "reached" && { label: words.placeTurn, value: `${fixed(place.turn, 0)}${deg}` },
          place.status === "reached" && {
            label: words.deflection,
            value: `${significant(value, 3)} ${micrometre}`,
          },
          place.status === "reached" && { label: words.ofBest, value: percent(value / best) },
          found !== undefined && {
            label: words.chosenPlace,
            value: <Estimate of={bandOf(found)} unit={micrometre} />,
          },
        ]}
      />
    </div>
  );
}
