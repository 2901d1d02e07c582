/** What lies in space by its deflection: a map, slice by slice, with the same by another run; and the path of a program that was compensated. */
import { useMemo, useRef, useState } from "preact/hooks";
import * as maps from "../../lib/map";
import { boundedLength } from "../../lib/estimate";
import { fixed, percent, significant, extent, timeText } from "../../lib/format";
import { text } from "../../words";
import { api } from "../../api/calls";
import { goesOn } from "../../api/follow";
import { queries } from "../../api/queries";
import type { Map as WorkMap } from "../../api/types";
import { Busy, Download, NameLink, Choice, Facts, ProblemNote, useWidth } from "../../components/basics";
import { AlongPath } from "../../charts/along_path";
import { BarFigure } from "../../charts/figure";
import { Estimate } from "../../components/estimate";
import { Handle, Select } from "../../components/fields";
import { Going, JobPage, JobLines, JobTables } from "../../components/job_page";
import { freshKey } from "../../lib/json";
import { postureText } from "../../lib/stiffness";
import { norm, subtract, type Vector } from "../../lib/vector";
import { RampLegend } from "../../charts/ramp";
import { ArmView, roomOf } from "../../scene/view";
import { asking, useAction, link } from "../../state/action";
import { useKinematics } from "../../state/kinematics";
import { ask, useQuery } from "../../state/query";
import { contextOfEnded } from "../../state/run_context";
import { howOf } from "../../lib/ways";
import { sceneWords } from "../../scene/words";
import { sourceWords } from "../../components/words";
import { correctWords, mapWords, predictWords } from "./words";
import { compareWords } from "../compare/words";

const AXES = ["x", "y", "z"] as const;
const MARGIN = { left: 60, bottom: 40, top: 8, right: 8 };
const HEIGHT = 600;

interface SliceProps extends Pick<Look, "values" | "scale" | "chosen" | "choose"> {
  slice: maps.Slice;
  places: maps.MapPlace[];
  width: number;
  label: string;
}

function SliceChart({ slice, places, values, scale, chosen, choose, width, label }: SliceProps) {
  const { u, v, cells } = slice;
  const columns = cells[0]?.length ?? 1;
  const position = (index: number | undefined, axis: 0 | 1 | 2) => places[index ?? 0]?.position[axis] ?? 0;
  const spanU = position(cells[0]?.at(-1), u) - position(cells[0]?.[0], u);
  const spanV = position(cells[0]?.[0], v) - position(cells.at(-1)?.[0], v);
  const room = Math.max(60, width - MARGIN.left - MARGIN.right);
  const shape = Math.max(0.05, spanU > 0 && spanV > 0 ? spanV / spanU : cells.length / columns);
  const high = Math.min(HEIGHT, Math.max(24, room * shape));
  const wide = Math.min(room, high / shape);
  const [w, h] = [wide / columns, high / cells.length];
  const row = cells.findIndex((line) => chosen !== null && line.includes(chosen));
  const at = row < 0 ? null : ([row, (cells[row] ?? []).indexOf(chosen ?? 0)] as const);
  const pick = (row: number, column: number) => {
    const index = cells[Math.min(cells.length - 1, Math.max(0, row))]?.[Math.min(columns - 1, Math.max(0, column))];
    if (index !== undefined) choose(index);
  };
  const tap = (event: MouseEvent & { currentTarget: SVGSVGElement }) => {
    const box = event.currentTarget.getBoundingClientRect();
    const x = event.clientX - box.left - MARGIN.left;
    const y = event.clientY - box.top - MARGIN.top;
    if (x >= 0 && y >= 0 && x < wide && y < high) pick(Math.floor(y / h), Math.floor(x / w));
  };
  const key = (event: KeyboardEvent) => {
    const step = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [-1, 0], ArrowDown: [1, 0] }[event.key];
    if (!step) return;
    event.preventDefault();
    const [row, column] = at ?? [0, 0];
    pick(row + (step[0] ?? 0), column + (step[1] ?? 0));
  };
  const height = high + MARGIN.top + MARGIN.bottom;
  const { left, top } = MARGIN;
  const mm = (index: number | undefined, axis: 0 | 1 | 2) => fixed(1e3 * position(index, axis), 0);
  const ticks = [
    [left, height - 22, "start", mm(cells[0]?.[0], u)],
    [left + wide, height - 22, "end", mm(cells[0]?.at(-1), u)],
    [left + wide / 2, height - 6, "middle", `${AXES[u]} [${text.units.mm}]`],
    [left - 6, top + 10, "end", mm(cells[0]?.[0], v)],
    [left - 6, top + high, "end", mm(cells.at(-1)?.[0], v)],
    [left - 6, top + high / 2 + 4, "end", `${AXES[v]} [${text.units.mm}]`],
  ] as const;
  return (
    <svg
      class="chart slice"
      role="img"
      aria-label={label}
      tabIndex={0}
      width={width}
      height={height}
      viewBox={`0 0 ${width} ${height}`}
      onClick={tap}
      onKeyDown={key}
    >
      {cells.map((line, row) =>
        line.map((index, column) => (
          <rect
            x={MARGIN.left + column * w}
            y={MARGIN.top + row * h}
            width={w + 0.4}
            height={h + 0.4}
            class={Number.isFinite(values[index]) ? undefined : `none ${places[index]?.status}`}
            style={{ fill: rampFill(share(values[index], scale)) }}
          />
        )),
      )}
      {at && (
        <rect
          class="chosen"
          x={MARGIN.left + at[1] * w}
          y={MARGIN.top + at[0] * h}
          width={Math.max(w, 4)}
          height={Math.max(h, 4)}
        />
      )}
      {ticks.map(([x, y, anchor, said]) => (
        <text class="tick" x={x} y={y} text-anchor={anchor}>
          {said}
        </text>
      ))}
    </svg>
  );
}

/** Place of a value between the ends of a scale; NaN where there is none. */
const share = (value: number | undefined, [low, high]: readonly [number, number]): number =>
  value === undefined ? Number.NaN : Math.min(1, Math.max(0, (value - low) / (high - low || 1)));

function rampFill(part: number): string | undefined {
  if (Number.isNaN(part)) return undefined;
  const [from, to, mix] = part < 0.5 ? ["--ramp-0", "--ramp-1", part * 2] : ["--ramp-1", "--ramp-2", part * 2 - 1];
  return `color-mix(in oklab, var(${to}) ${(mix * 100).toFixed(1)}%, var(${from}))`;
}

const words = mapWords;

/** A map with what it is about; without places while it goes on. */
async function load(id: string, signal: AbortSignal) {
  const map = await api.maps.one(id, signal);
  const places = map.result ? maps.placesOf(await ask(queries.table(id, "map"))) : [];
  return { map, places, ...(await contextOfEnded(map.request.run_id)) };
}

type Loaded = Awaited<ReturnType<typeof load>>;

export function MapView({ id, query }: { id: string; query: URLSearchParams }) {
  const beside = query.get("beside");
  return (
    <JobPage
      key={beside}
      collection="maps"
      id={id}
      kind={text.run.views.map}
      load={async (signal) => {
        const own = await load(id, signal);
        return { job: own.map, own, other: beside ? await load(beside, signal) : null };
      }}
      head={({ job, own: { run, set } }) => ({
        name: job.request.name ?? words.title(set.name),
        list: link(["runs", run.id]),
        run,
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
  const sides = [own, other].filter((one): one is Loaded => one !== null && one.places.length > 0);
  const [quantity, setQuantity] = useState<maps.Quantity>("deflection");
  const values = sides.map(({ places }) => places.map((place) => maps.valueOfPlace(place, quantity)));
  const found = extent(values.flat());
  const scale = found ?? [0, 1];
  const [across, setAcross] = useState<maps.Axis>(() => maps.thinnest(grid));
  const [chosen, setChosen] = useState(() => maps.greatest(values[0] ?? []) ?? 0); // the worst place is seen first
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
          <Choice label={correctWords.colour} value={quantity} change={setQuantity} options={words.quantities} />
          {found && <RampLegend scale={found} unit={unit} label={words.quantities[quantity]} />}
          <Choice
            label={words.across}
            value={String(across)}
            change={(axis) => setAcross(Number(axis) as maps.Axis)}
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
  across: maps.Axis;
  layer: number;
}

function Robot({ loaded: { places, set, map }, look }: { loaded: Loaded; look: Look }) {
  const { chosen, values, scale } = look;
  const joints = places[chosen]?.joints ?? [];
  const last = useRef(joints); // where the robot does not reach, it stays
  if (joints.length > 0) last.current = joints;
  const { kinematics } = useKinematics(last.current.length > 0 ? { robot_id: set.robot_id } : null, [last.current]);
  const posture = kinematics?.[0];
  const kept = places.flatMap((place, i) => (Number.isFinite(values[i]) ? [{ place, i }] : []));
  if (!posture) return <div class="stage blank">{words.tap}</div>;
  // A force that turns with the flange is not drawn: its direction differs from place to place.
  const pulls = norm(map.request.force) > 0 && map.request.axes !== "flange";
  return (
    <ArmView
      posture={posture}
      axes={false}
      cloud={{
        places: kept.map(({ place }) => place.position),
        shares: kept.map(({ i }) => share(values[i], scale)),
        size: spacing(map) * 0.6,
      }}
      load={pulls ? { from: places[chosen]?.position ?? [0, 0, 0], along: map.request.force } : null}
      room={[...roomOf([posture]), ...map.request.area]}
      label={words.view}
    />
  );
}

function Sliced({ loaded, look, label }: { loaded: Loaded; look: Look; label: string }) {
  const { map, places, run, set } = loaded;
  const { across, layer, chosen } = look;
  const [box, width] = useWidth<HTMLDivElement>();
  const slice = maps.sliceOf(map.request.grid, across, layer, map.request.area);
  const place = places[chosen];
  return (
    <section class="card">
      <h2>
        <NameLink to={["runs", run.id]}>{set.name}</NameLink>{" "}
        <small class="soft">{text.methods[run.request.method]}</small>
      </h2>
      <div ref={box}>{width > 0 && <SliceChart {...look} {...{ slice, places, width, label }} />}</div>
      {place && <Numbers place={place} map={map} />}
    </section>
  );
}

const scaled = ([low, high]: readonly [number, number]) => [1e6 * low, 1e6 * high] as const;

function Numbers({ place, map }: { place: maps.MapPlace; map: WorkMap }) {
  const level = percent(map.request.confidence);
  const { mm, micrometre, micrometrePerNewton: perNewton } = text.units;
  const kinds = Object.values(map.result?.joint_kinds ?? {});
  const reached = place.status === "reached";
  const standing = [
    { label: words.position, value: `${place.position.map((v) => fixed(1e3 * v, 0)).join(", ")} ${mm}` },
    place.joints.length > 0 && { label: predictWords.labels.joints, value: postureText(place.joints, kinds, 1) },
  ];
  const withModel = Number.isFinite(place.withModelError[1]);
  const deflection = boundedLength(
    1e6 * place.deflection,
    scaled(withModel ? place.withModelError : place.readingsOnly),
  );
  const unusable = map.result?.assessment.verdict === "do_not_use";
  const compliance = (value: number) =>
    Number.isFinite(value) ? `${significant(value * 1e6, 3)} ${perNewton}` : words.noNumber;
  const bent = [
    {
      label: words.quantities.deflection,
      value: <Estimate of={{ ...deflection, unusable }} unit={micrometre} />,
    },
    {
      label: sourceWords.inBrackets,
      value: <span class="brackets">{sourceWords.source(level, withModel)}</span>,
    },
    {
      label: words.displacement,
      value: `${place.displacement.map((v) => significant(v * 1e6, 3)).join(", ")} ${micrometre}`,
    },
    { label: words.along, value: compliance(place.along) },
    { label: words.acrossIt, value: compliance(place.across) },
  ];
  return (
    <div aria-live="polite">
      {!reached && <p class="note">{words.status[place.status]}</p>}
      <Facts facts={[...(reached ? bent : []), ...standing]} />
      {reached && place.extrapolation > 1.01 && (
        <p class="note warn">{words.extrapolates(significant(place.extrapolation, 3))}</p>
      )}
    </div>
  );
}

/** Another run of the same robot, whose map of the same is made when it is chosen. */
function Beside({ own, other }: { own: Loaded; other: Loaded | null }) {
  const { data: runs } = useQuery(queries.runs({ robot_id: own.set.robot_id, state: "succeeded", limit: 100 }));
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
      label: compareWords.runSide(run.measurement_set_name ?? "", howOf(run), timeText(run.created_at)),
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

/** How far apart neighbours along an axis of the grid are in the list of places. */
const strideOf = (grid: Grid, axis: maps.Axis): number => [grid[1] * grid[2], grid[2], 1][axis] ?? 1;

/** Index of a place along an axis of the grid. */
const layerOf = (grid: Grid, axis: maps.Axis, place: number): number =>
  Math.floor(place / strideOf(grid, axis)) % grid[axis];

/** The place in another layer across an axis. */
const moved = (grid: Grid, axis: maps.Axis, place: number, layer: number): number =>
  place + (layer - layerOf(grid, axis, place)) * strideOf(grid, axis);

/** Least distance of two neighbouring places [m]. */
function spacing({ request: { area, grid } }: WorkMap): number {
  const steps = ([0, 1, 2] as const)
    .filter((i) => grid[i] > 1 && area[1][i] > area[0][i])
    .map((i) => (area[1][i] - area[0][i]) / (grid[i] - 1));
  return steps.length > 0 ? Math.min(...steps) : 0.05;
}

const MOST_DRAWN = 3_000;
const FINEST = 150; // points side by side along the path: more are drawn over each other
const COARSEST = 25;

async function loadCorrection(id: string, signal: AbortSignal) {
  const job = await api.corrections.one(id, signal);
  const points = job.result?.program ? maps.pointsOf(await ask(queries.table(id, "rows"))) : [];
  return { job, points, ...(await contextOfEnded(job.request.run_id ?? "")) };
}

export function CorrectionView({ id }: { id: string }) {
  return (
    <JobPage
      collection="corrections"
      id={id}
      kind={correctWords.kind}
      load={(signal) => loadCorrection(id, signal)}
      head={({ job, run, set }) => ({
        name: (job.request.files ?? [])[0]?.name ?? correctWords.kind,
        list: link(["runs", run.id]),
        run,
        about: <NameLink to={["runs", run.id]}>{set.name}</NameLink>,
        first: job.result?.program?.files.map((file) => (
          <Download look="primary" href={api.correctedFile(id, file.name)}>
            <span class="clip">{correctWords.download(file.name)}</span>
          </Download>
        )),
        actions: job.result && <Download href={api.jobs.file(id, "rows.csv")}>{correctWords.table}</Download>,
      })}
    >
      {(_, loaded) => (
        <>
          <JobLines collection="corrections" id={loaded.job.id} />
          {loaded.points.length > 0 && <Path loaded={loaded} />}
          <JobTables collection="corrections" id={loaded.job.id} />
        </>
      )}
    </JobPage>
  );
}

function Path({ loaded: { job, points, robot } }: { loaded: Awaited<ReturnType<typeof loadCorrection>> }) {
  const confidence = job.result?.confidence ?? 0.95;
  const unusable = job.result?.assessment.verdict === "do_not_use";
  const [when, setWhen] = useState<"before" | "after">("before");
  const [look, setLook] = useState<keyof typeof correctWords.looks>("path");
  const [chosen, setChosen] = useState(0);
  const drawn = useMemo(() => maps.thinned(points, MOST_DRAWN), [points]);
  const point = points[chosen];
  const { kinematics } = useKinematics(point ? { robot_id: robot.id } : null, point ? [point.joints] : []);
  const posture = kinematics?.[0];
  const size = lengthOf(drawn.map((one) => one.place)) / Math.min(FINEST, Math.max(COARSEST, drawn.length));
  const most = points.reduce((top, one) => (one.deflection > top ? one.deflection : top), 0);
  const loaded = drawn.filter((one) => Number.isFinite(one.deflection));
  const cloud = {
    places: loaded.map((one) => one.place),
    shares: loaded.map((one) => share(when === "before" ? one.deflection : one.residual, [0, most])),
    size,
  };
  if (!posture || !point) return <Busy label={sceneWords.loading} />;
  const { flange_origin: flange } = posture;
  const path = drawn.map((one) => one.place);
  return (
    <>
      <section class="scene">
        <div class="view">
          <ArmView
            posture={posture}
            axes={false}
            predicted={[{ from: flange, along: subtract(point.place, flange) }]}
            cloud={cloud}
            room={look === "path" ? around(path) : [...roomOf([posture]), ...path]}
            near={look === "path"}
            label={correctWords.view}
          />
        </div>
        <div class="controls">
          <Choice
            label={correctWords.colour}
            value={when}
            change={setWhen}
            options={{ before: text.assessment.before, after: correctWords.afterShort }}
          />
          <RampLegend scale={[0, most]} unit={text.units.mm} label={correctWords.off} />
          <Choice label={correctWords.look} value={look} change={setLook} options={correctWords.looks} />
          <Handle label={correctWords.choosePoint} count={points.length} value={chosen} change={setChosen}>
            {correctWords.point(point.number, point.line)}
          </Handle>
          <PathFacts point={point} level={percent(confidence)} unusable={unusable} />
        </div>
      </section>
      <Charts points={points} level={percent(confidence)} chosen={chosen} choose={setChosen} />
    </>
  );
}

interface PathFactsProps {
  point: maps.PathPoint;
  /** Of the intervals. */
  level: string;
  unusable: boolean;
}

/** The distance from the target of a point, before and after. */
function PathFacts({ point, level, unusable }: PathFactsProps) {
  const shown = (value: number, ends: readonly [number, number]) => (
    <Estimate of={{ ...boundedLength(value, ends), unusable }} unit={text.units.mm} />
  );
  return (
    <Facts
      facts={[
        { label: text.assessment.before, value: shown(point.deflection, point.interval) },
        { label: correctWords.after, value: shown(point.residual, point.residualInterval) },
        {
          label: sourceWords.inBrackets,
          value: <span class="brackets">{sourceWords.source(level, point.withModelError)}</span>,
        },
      ]}
    />
  );
}

interface ChartsProps {
  points: maps.PathPoint[];
  /** Of the intervals. */
  level: string;
  chosen: number;
  choose: (point: number) => void;
}

/** Distances from the targets along the path, and how often each distance is found. */
function Charts({ points, level, chosen, choose }: ChartsProps) {
  const { mm } = text.units;
  const loaded = points.filter(({ deflection }) => Number.isFinite(deflection));
  const source = sourceWords.source(
    level,
    loaded.every(({ withModelError }) => withModelError),
  );
  const both = [
    {
      mark: "as-sent",
      label: text.assessment.before,
      values: points.map(({ deflection }) => deflection),
      ends: points.map(({ interval }) => interval),
    },
    {
      mark: "as-corrected",
      label: correctWords.afterShort,
      values: points.map(({ residual }) => residual),
      ends: points.map(({ residualInterval }) => residualInterval),
    },
  ];
  const { width, counts } = maps.binned(
    both.map(({ values }) => values),
    BINS,
  );
  const digits = Math.max(0, -Math.floor(Math.log10(width) + 1e-9));
  const axis = correctWords.alongAxis;
  return (
    <>
      <AlongPath
        title={correctWords.along}
        along={points.map(({ along }) => 1e3 * along)}
        lines={both}
        bands={both.map(({ mark, label, ends }) => ({ mark, label: correctWords.band(label, source), ends }))}
        axes={{ along: axis, value: mm, unit: mm, alongUnit: axis }}
        chosen={chosen}
        choose={choose}
      />
      <BarFigure
        title={correctWords.often}
        note={correctWords.oftenNote(`${significant(width, 2)} ${mm}`)}
        names={counts[0]?.map((_, i) => fixed(i * width, digits)) ?? []}
        series={both.map(({ mark, label }, i) => ({ mark, label, values: counts[i] ?? [] }))}
        unit={correctWords.points}
        named={correctWords.binAxis}
      />
    </>
  );
}

const BINS = 24;

/** Corners of a box around a path, with room for the tool. */
function around(path: Vector[]): Vector[] {
  const [low, high] = maps.boxAround(path, 0.15);
  return [low, high];
}

/** Greatest length of a path along an axis, 0.1 m at least. */
function lengthOf(places: Vector[]): number {
  const ends = ([0, 1, 2] as const).map((axis) => extent(places.map((place) => place[axis])) ?? [0, 0]);
  return Math.max(0.1, ...ends.map(([low = 0, high = 0]) => high - low));
}
