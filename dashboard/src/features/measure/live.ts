/** One reading of a live campaign: from what is typed (lengths in mm), planned or simulated to what is posted. */
import type { JointKind, Observation, Units, MeasurementSet, Plan, PlanResult, Posture, Robot } from "../../api/types";
import { listIn, numberIn, scaled, vectorIn } from "../../lib/schema";
import { factors, positionIn } from "../../lib/stiffness";
import { type Vector, bendOf, bent, dot, norm, placesOf, subtract, times, carried, fromFlange } from "../../lib/vector";
import { type Fields, isFields, listOf } from "../../lib/json";
import { SI, type Stand, inUnits } from "../../lib/observation";

/** What is typed for a target, in mm. */
export interface Typed {
  unloaded: string;
  loaded: string;
  /** After the load was taken off; absent unless the user reads again. */
  unloaded_after?: string;
}

export type Rows = Record<string, Typed>;

/**
 * Rows with the positions [m] of a tracker in a column. A target that the tracker had filled and lost is blank: what
 * it said before trouble is of no use.
 */
export function tracked(
  rows: Rows,
  column: keyof Typed,
  points: Record<string, readonly number[]>,
  before: ReadonlySet<string>,
): Rows {
  const next = { ...rows };
  for (const [target, typed] of Object.entries(rows)) {
    const place = points[target];
    if (place) next[target] = { ...typed, [column]: place.map((part) => (1e3 * part).toFixed(4)).join(" ") };
    else if (before.has(target)) next[target] = { ...typed, [column]: "" };
  }
  return next;
}

/** Whether all targets have their three numbers in a column. */
export const isComplete = (rows: Rows, column: keyof Typed): boolean =>
  Object.values(rows).every((typed) => vectorIn(typed[column] ?? ""));

/** The first target whose numbers are missing or cannot be read; null if there is none. Blank ones are left out. */
export function unread(rows: Rows, unloadedOnly: boolean): string | null {
  const complete = ({ unloaded, loaded, unloaded_after }: Typed) =>
    vectorIn(unloaded) && (unloadedOnly || vectorIn(loaded)) && (!unloaded_after?.trim() || vectorIn(unloaded_after));
  const begun = Object.entries(rows).filter(([, { unloaded, loaded }]) => unloaded.trim() || loaded.trim());
  const lacking = begun.find(([, typed]) => !complete(typed));
  return lacking?.[0] ?? (begun.length === 0 ? (Object.keys(rows)[0] ?? "") : null);
}

/** The observation to post, in the units of the set. */
export function observationOf(
  label: string,
  { joints, force }: Stand,
  rows: Rows,
  units: Units,
  kinds: readonly JointKind[],
  unloadedOnly: boolean,
): Observation {
  const place = (typed: string) => vectorIn(typed)?.map((value) => scaled(value, 1e-3)) ?? null;
  const readings = Object.entries(rows)
    .filter(([, { unloaded }]) => unloaded.trim())
    .map(([target, { unloaded, loaded, unloaded_after }]) => ({
      target,
      unloaded: place(unloaded),
      ...(unloadedOnly ? {} : { loaded: place(loaded) }),
      ...(unloaded_after?.trim() ? { unloaded_after: place(unloaded_after) } : {}),
    }));
  return inUnits({ label, joints, force, readings } as unknown as Observation, SI, units, kinds);
}

/** Joints as typed, in degrees and mm, and a force in N; null if a number is missing. */
export function standTyped(joints: string, force: string, kinds: readonly JointKind[]): Stand | null {
  const [angles, along] = [listIn(joints), vectorIn(force)];
  if (!along || angles?.length !== kinds.length) return null;
  return { joints: angles.map((value, i) => positionIn(value, kinds[i])), force: along, anchor: null };
}

/** A label that nobody has taken: `wanted`, or the next number of its kind. */
export function freeLabel(wanted: string, taken: Set<string>): string {
  let label = wanted;
  for (let number = taken.size + 1; taken.has(label); number++) label = `m${String(number).padStart(2, "0")}`;
  return label;
}

/** The rows of a plan's list whose readings are filled in, by the names of the columns that an import reads; null of another table. */
export function filledRecords(table: string): Fields[] | null {
  const [head = "", ...rows] = table.replace(/^\ufeff/, "").split(/\r?\n/);
  const mark = [";", "\t", ","].find((each) => head.includes(each)) ?? ",";
  const names = head.split(mark).map((name) => name.replace(/^joint_(?=\d)/, "J")); // as an import has them
  const readings = names.flatMap((name, i) => (/\b(unloaded|loaded)\b/i.test(name) ? [i] : []));
  const columns = names.flatMap((name, i) =>
    /^(label|J\d+|[FM][xyz])\b/.test(name) || readings.includes(i) ? [i] : [],
  );
  if (readings.length === 0 || table.includes('"')) return null;
  const filled = rows.map((row) => row.split(mark)).filter((cells) => readings.some((i) => cells[i]?.trim()));
  const valueOf = (cell = "") => {
    const number = numberIn(cell);
    return Number.isNaN(number) ? cell : number;
  };
  return filled.map((cells) => Object.fromEntries(columns.map((i) => [names[i], valueOf(cells[i])])));
}

export type Planned = PlanResult["readings"][number];

/**
 * The equipment of a campaign, to begin another one with: its targets, its load point and its strongest load, in SI.
 * Targets that it does not state are where its first observation shows them on the flange, to 0.1 mm.
 */
export function equipmentOf(set: MeasurementSet, first?: Posture): Fields {
  const { length, force: unit } = factors(set.units);
  const metres = (place: readonly number[]) => place.map((part) => Number((length * part).toFixed(6)));
  const [observation] = set.observations;
  const forces = set.observations.map(({ force }) => times(force as Vector, unit));
  const strongest = forces.reduce<Vector>((best, force) => (norm(force) > norm(best) ? force : best), [0, 0, 0]);
  const hangs = forces.every(([x, y, z]) => z <= 0 && Math.hypot(x, y) <= 1e-3 * norm(strongest));
  const point = set.load_point ?? set.observations[0]?.load_point;
  const targets = Object.entries(set.flange_targets ?? {}).map(([name, place]) => [name, metres(place)]);
  if (targets.length === 0 && first && observation)
    for (const [name, place] of placesOf(set, observation, first)) {
      const fromOrigin = subtract(place, first.flange_origin);
      targets.push([name, first.flange_axes.map((axis) => Number(dot(axis, fromOrigin).toFixed(4)))]);
    }
  return {
    ...(targets.length > 0 ? { targets: Object.fromEntries(targets) } : {}),
    ...(point ? { load_point: metres(point) } : {}),
    ...(norm(strongest) > 0
      ? { load: { kind: hangs ? "dead_weight" : "any_direction", force: Math.round(norm(strongest)) } }
      : {}),
  };
}

/** What was found of the fields that are still as they began. */
export const unchanged = (found: Fields, now: Fields, start: Fields): Fields =>
  Object.fromEntries(Object.entries(found).filter(([name]) => now[name] === start[name]));

/** A campaign to fill in: the set so far with the planned readings after it, whose positions are null. */
export function toFillIn(
  { request, result }: Plan,
  robot: Pick<Robot, "id" | "joints">,
  base: MeasurementSet | null,
): Fields {
  const targets = Object.keys(result?.targets ?? {});
  const kinds = robot.joints.map(({ kind }) => kind);
  const planned = (result?.readings ?? []).map(({ label, joints, force }) => {
    const readings = targets.map((target) => ({ target, unloaded: null, loaded: null }));
    return inUnits({ label, joints, force, readings } as unknown as Observation, SI, base?.units ?? SI, kinds);
  });
  if (base) {
    const { id, created_at, content_hash, warnings, resolved_frame, geometry_targets, open, live, ...document } = base;
    return { ...document, observations: [...base.observations, ...planned] };
  }
  return {
    robot_id: robot.id,
    name: "planned campaign",
    units: SI,
    encoders: "motor",
    ...(request.sigma === null ? {} : { noise: { sigma: request.sigma } }),
    load_point: result?.load_point,
    observations: planned,
  };
}

/** The set with those observations only whose readings are all there; null if there is none. */
export function readSoFar(set: Fields): { document: Fields; labels: string[] } | null {
  const observations = listOf(set["observations"]).filter(isRead);
  if (observations.length === 0) return null;
  return { document: { ...set, observations }, labels: observations.map((each) => String(each["label"])) };
}

/** Whether all positions of its readings are there; a deflection may be missing beside them. */
function isRead(observation: unknown): observation is Fields {
  const readings = isFields(observation) ? listOf(observation["readings"]) : [];
  const isThere = (reading: Fields, name: string) =>
    reading[name] !== null || (name === "deflection" && Array.isArray(reading["unloaded"]));
  return readings.length > 0 && readings.every((each) => POSITIONS.every((name) => isThere(each, name)));
}

const POSITIONS = ["unloaded", "loaded", "deflection"];

/** What a set says that was opened as a simulated one. */
export const SIMULATED = "simulated by the page";
export const SIMULATED_ARM = "KUKA KR 210 R2700 extra";
export const SIMULATED_MASS = 150;
export const SIMULATED_LOAD_POINT: Vector = [-0.06, 0.02, 0.18];
export const SIMULATED_TARGETS: Record<string, Vector> = {
  P1: [0.147, 0.055, 0.05],
  P2: [-0.137, 0.087, 0.085],
  P3: [-0.007, -0.14, 0.12],
};
export const SIGMA = 2e-5;
/** Of its joints [N·m/rad]. */
export const SIMULATED_STIFFNESSES = [3.4e6, 3.6e6, 2.1e6, 0.51e6, 0.22e6, 0.1e6];
const BALANCES = 30;

/**
 * Angles [rad] by which revolute joints give way until the springs balance a force [N] at a point of the flange:
 * angle = torque / stiffness, torque about the axes where they then are.
 */
export function givenWay(posture: Posture, stiffnesses: readonly number[], at: Vector, force: Vector): number[] {
  const count = posture.joint_origins.length;
  const [point, compliances] = [onFlange(posture, at), stiffnesses.map((stiffness) => 1 / stiffness)];
  let angles = Array<number>(count).fill(0);
  for (let round = 0; round < BALANCES; round++)
    angles = bendOf(bent(posture, angles), compliances, { point: carried(posture, angles, point, count), force });
  return angles;
}

const onFlange = (posture: Posture, place: Vector): Vector =>
  fromFlange(posture.flange_origin as unknown as Vector, posture.flange_axes as unknown as Vector[], place);

/** Readings of the targets before and under a load, in mm as they would be typed. */
export function simulatedRows(
  posture: Posture,
  force: Vector,
  { targets, loadPoint }: { targets: Record<string, Vector>; loadPoint: Vector },
): Rows {
  const normal = () => Math.sqrt(-2 * Math.log(1 - Math.random())) * Math.cos(2 * Math.PI * Math.random());
  const angles = givenWay(posture, SIMULATED_STIFFNESSES, loadPoint, force);
  const read = (place: Vector) => place.map((part) => (1e3 * (part + SIGMA * normal())).toFixed(4)).join(" ");
  return Object.fromEntries(
    Object.entries(targets).map(([name, place]) => {
      const before = onFlange(posture, place);
      return [name, { unloaded: read(before), loaded: read(carried(posture, angles, before, angles.length)) }];
    }),
  );
}

/** The same with the first two targets exchanged: a mistake as it happens. */
export function exchanged(rows: Rows): Rows {
  const [first, second] = Object.keys(rows);
  if (first === undefined || second === undefined) return rows;
  return { ...rows, [first]: rows[second] as Typed, [second]: rows[first] as Typed };
}
