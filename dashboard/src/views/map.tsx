/** A map: slices with their numbers, the robot at the chosen place, and the same by another run beside it. */
import { useMemo, useRef, useState } from "preact/hooks";
import { api } from "../api/client";
import { goesOn } from "../api/events";
import type { Map as WorkMap } from "../api/types";
import { Download, NameLink, Choice, Facts, ProblemNote } from "../components/basics";
import { Handle, Select } from "../components/fields";
import { Going } from "../components/going";
import { JobPage } from "../components/job_page";
import { JobLines } from "../components/job_tables";
import { RampLegend, share, SliceChart } from "../components/slice";
import { decimalsFor, fixed, percent, significant } from "../lib/format";
import { freshKey } from "../lib/hash";
import {
  type Axis,
  greatest,
  type MapPlace,
  placesOf,
  type Quantity,
  sliceOf,
  thinnest,
  valueOfPlace,
} from "../lib/map";
import { extent } from "../lib/scale";
import { postureText } from "../lib/units";
import { norm } from "../lib/vector";
import { ARM_ALONE, type Show as Shown } from "../scene/show";
import { ArmView, roomOf } from "../scene/view";
import { asking, useAction } from "../state/action";
import { cached, useCached, useLoad, valueOf } from "../state/load";
import { useKinematics } from "../state/posture";
import { link } from "../state/router";
import { useWidth } from "../state/size";
import { storedSet } from "../state/names";
import { text } from "../i18n";
import { later } from "../i18n/later";
import { contextOfEnded, type RunContext } from "./run_context";

const words = later.map;
const AXES = ["x", "y", "z"] as const;

/** A map with what it is about; without places while it goes on. */
interface Loaded extends RunContext {
  map: WorkMap;
  places: MapPlace[];
}

async function load(id: string, signal: AbortSignal): Promise<Loaded> {
  const map = await api.maps.one(id, signal);
  const places = map.result ? placesOf(await cached(`map/${id}`, () => api.mapTable(id))) : [];
  return { map, places, ...(await contextOfEnded(map.request.run_id)) };
}

export function MapView({ id, beside }: { id: string; beside: string | null }) {
  return (
    <JobPage
      key={beside}
      collection="maps"
      id={id}
      kind={words.kind}
      load={async (signal) => {
        const own = await load(id, signal);
        return { job: own.map, own, other: beside ? await load(beside, signal) : null };
      }}
      head={({ job, own: { run, set } }) => ({
        name: job.request.name ?? words.title(set.name),
        list: link(["runs", run.id]),
        about: <NameLink to={["runs", run.id]}>{set.name}</NameLink>,
        actions:
          job.result &&
          (["csv", "npz"] as const).map((extension) => (
            <Download href={api.jobs.file(id, `map.${extension}`)}>{words[extension]}</Download>
          )),
      })}
    >
      {(_, { own, other }, reload) =>
        other && goesOn(other.map.state) ? (
          <Going job={other.map} ended={reload} />
        ) : (
          <Explorer own={own} other={other} />
        )
      }
    </JobPage>
  );
}

function Explorer({ own, other }: { own: Loaded; other: Loaded | null }) {
  const { grid } = own.map.request;
  const sides = useMemo(
    () => [own, other].filter((one): one is Loaded => one !== null && one.places.length > 0),
    [own, other],
  );
  const [quantity, setQuantity] = useState<Quantity>("deflection");
  const values = useMemo(
    () => sides.map(({ places }) => places.map((place) => valueOfPlace(place, quantity))),
    [sides, quantity],
  );
  const scale = extent(values.flat()) ?? [0, 1];
  const [across, setAcross] = useState<Axis>(() => thinnest(grid));
  const [chosen, setChosen] = useState(() => {
    const isMiddle = (place: number) => layerOf(grid, across, place) === Math.floor(grid[across] / 2);
    return (
      greatest((values[0] ?? []).map((value, i) => (isMiddle(i) ? value : Number.NaN))) ??
      greatest(values[0] ?? []) ??
      0
    );
  });
  const layer = layerOf(grid, across, chosen);
  const unit =
    quantity === "deflection" || quantity === "upper" ? text.units.micrometre : text.units.micrometrePerNewton;
  const height = fixed(1e3 * (own.places[chosen]?.position[across] ?? 0), 0);
  const lookAt = (i: number): Look => ({ values: values[i] ?? [], scale, chosen, choose: setChosen, across, layer });
  return (
    <>
      <JobLines collection="maps" id={own.map.id} />
      <section class="scene">
        <div class="view">
          <Robot loaded={own} look={lookAt(0)} />
        </div>
        <div class="controls">
          <Choice label={words.quantity} value={quantity} change={setQuantity} options={words.quantities} />
          <RampLegend scale={scale} unit={unit} label={words.quantities[quantity]} />
          <Choice
            label={words.across}
            value={String(across)}
            change={(axis) => setAcross(Number(axis) as Axis)}
            options={AXES.map((label, i) => ({ value: String(i), label }))}
          />
          <Handle
            label={words.across}
            count={grid[across]}
            value={layer}
            change={(to) => setChosen(moved(grid, across, chosen, to))}
          >
            {words.layer(AXES[across], height)}
          </Handle>
          <Beside own={own} other={other} />
        </div>
      </section>
      <div class="slices">
        {sides.map((side, i) => (
          <Sliced key={side.map.id} loaded={side} look={lookAt(i)} label={words.slice(AXES[across], height)} />
        ))}
      </div>
    </>
  );
}

/** What is looked at: values of all places with their colours, one place, and the slice that it is in. */
interface Look {
  values: number[];
  scale: readonly [number, number];
  chosen: number;
  choose: (place: number) => void;
  across: Axis;
  layer: number;
}

function Robot({ loaded: { places, set, map }, look }: { loaded: Loaded; look: Look }) {
  const { chosen, values, scale } = look;
  const joints = places[chosen]?.joints ?? [];
  const last = useRef(joints); // where the robot does not reach, it stays
  if (joints.length > 0) last.current = joints;
  const { kinematics } = useKinematics(last.current.length > 0 ? { robot_id: set.robot_id } : null, [last.current]);
  const posture = kinematics?.postures[0];
  const drawn = useMemo(() => {
    const kept = places.flatMap((place, i) => (Number.isFinite(values[i]) ? [{ place, i }] : []));
    return {
      places: kept.map(({ place }) => place.position),
      shares: kept.map(({ i }) => share(values[i], scale)),
      size: spacing(map) * 0.6,
    };
  }, [places, values, scale[0], scale[1]]);
  const shown = useMemo<Shown | null>(
    () =>
      posture
        ? {
            ...ARM_ALONE,
            axes: false,
            posture,
            cloud: drawn,
            // A force that turns with the flange is not drawn: its direction differs from place to place.
            load:
              norm(map.request.force) > 0 && map.request.axes !== "flange"
                ? { from: places[chosen]?.position ?? [0, 0, 0], along: map.request.force }
                : null,
          }
        : null,
    [posture, drawn, chosen],
  );
  const room = useMemo(() => [...(posture ? roomOf([posture]) : []), ...map.request.area], [posture, map]);
  if (!shown) return <div class="stage blank">{words.tap}</div>;
  return <ArmView show={shown} room={room} label={words.view} />;
}

function Sliced({ loaded, look, label }: { loaded: Loaded; look: Look; label: string }) {
  const { map, places, run, set } = loaded;
  const { across, layer, chosen } = look;
  const [box, width] = useWidth<HTMLDivElement>();
  const slice = useMemo(() => sliceOf(map.request.grid, across, layer), [map, across, layer]);
  const place = places[chosen];
  return (
    <section class="card">
      <h3>
        <NameLink to={["runs", run.id]}>{set.name}</NameLink>{" "}
        <small class="soft">{text.methods[run.request.method]}</small>
      </h3>
      <div ref={box}>{width > 0 && <SliceChart {...look} {...{ slice, places, width, label }} />}</div>
      {place && <Numbers place={place} map={map} />}
    </section>
  );
}

function Numbers({ place, map }: { place: MapPlace; map: WorkMap }) {
  const level = percent(map.request.confidence);
  const um = (value: number, width: number) => fixed(value * 1e6, Math.max(0, decimalsFor(width * 0.25e6)));
  const { mm, micrometre, micrometrePerNewton: perNewton } = text.units;
  const position = { label: words.position, value: `${place.position.map((v) => fixed(1e3 * v, 0)).join(", ")} ${mm}` };
  const angles = {
    label: words.angles,
    value: postureText(place.joints, Object.values(map.result?.joint_kinds ?? {}), 1),
  };
  const posed = place.joints.length > 0 ? [angles] : [];
  if (place.status !== "reached")
    return (
      <div aria-live="polite">
        <p class="note">{words.status[place.status]}</p>
        <Facts facts={[position, ...posed]} />
      </div>
    );
  const interval = ([low, high]: readonly [number, number]) =>
    Number.isFinite(high) ? `${um(low, high - low)} … ${um(high, high - low)} ${micrometre}` : words.noBound;
  const compliance = (value: number) =>
    Number.isFinite(value) ? `${significant(value * 1e6, 3)} ${perNewton}` : words.noNumber;
  return (
    <div aria-live="polite">
      <Facts
        facts={[
          { label: words.deflection, value: `${significant(place.deflection * 1e6, 4)} ${micrometre}` },
          { label: words.readingsOnly(level), value: interval(place.readingsOnly) },
          { label: words.withModelError(level), value: interval(place.withModelError) },
          {
            label: words.displacement,
            value: `${place.displacement.map((v) => significant(v * 1e6, 3)).join(", ")} ${micrometre}`,
          },
          { label: words.along, value: compliance(place.along) },
          { label: words.acrossIt, value: compliance(place.across) },
          position,
          ...posed,
        ]}
      />
      {place.extrapolation > 1.01 && <p class="note warn">{words.extrapolates(significant(place.extrapolation, 3))}</p>}
    </div>
  );
}

/** Another run of the same robot, whose map of the same is made when it is chosen. */
function Beside({ own, other }: { own: Loaded; other: Loaded | null }) {
  const runs = valueOf(
    useCached(`runs/robot/${own.set.robot_id}`, () =>
      api.runs.list({ robot_id: own.set.robot_id, state: "succeeded", limit: 100 }),
    ),
  );
  const sets = useLoad(async () => {
    const ids = new Set((runs?.items ?? []).map((run) => run.measurement_set_id));
    return new Map(await Promise.all([...ids].map(async (id) => [id, (await storedSet(id)).name] as const)));
  }, [runs]);
  const names = valueOf(sets);
  const make = useAction(async (run: string) => {
    if (run === "") return link(["maps", own.map.id]);
    const stated = { ...own.map.request, run_id: run, accept_verdict: null };
    const made = await asking((accepted) => api.maps.add({ ...stated, ...accepted }, freshKey("map")));
    return link(["maps", own.map.id], { beside: made.id });
  });
  const options = (runs?.items ?? [])
    .filter((run) => run.id !== own.run.id)
    .map((run) => ({
      value: run.id,
      label: `${names?.get(run.measurement_set_id) ?? ""} · ${text.methods[run.method]}`,
    }));
  if (options.length === 0) return null;
  return (
    <>
      <Select
        label={words.beside}
        help={words.besideHint}
        value={other?.run.id ?? ""}
        change={make.run}
        options={[{ value: "", label: words.besideNone }, ...options]}
      />
      {make.problem && <ProblemNote problem={make.problem} />}
    </>
  );
}

type Grid = WorkMap["request"]["grid"];

/** Index of a place along an axis of the grid. */
function layerOf(grid: Grid, axis: Axis, place: number): number {
  const z = place % grid[2];
  const y = Math.floor(place / grid[2]) % grid[1];
  const x = Math.floor(place / (grid[2] * grid[1]));
  return [x, y, z][axis] ?? 0;
}

/** The place in another layer across an axis. */
function moved(grid: Grid, axis: Axis, place: number, layer: number): number {
  const step = [grid[1] * grid[2], grid[2], 1][axis] ?? 1;
  return place + (layer - layerOf(grid, axis, place)) * step;
}

/** Least distance of two neighbouring places [m]. */
function spacing({ request: { area, grid } }: WorkMap): number {
  const steps = ([0, 1, 2] as const)
    .filter((i) => grid[i] > 1 && area[1][i] > area[0][i])
    .map((i) => (area[1][i] - area[0][i]) / (grid[i] - 1));
  return steps.length > 0 ? Math.min(...steps) : 0.05;
}
