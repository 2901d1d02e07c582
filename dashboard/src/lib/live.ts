/** One reading of a live campaign: from what is typed to what is posted. Lengths are typed in mm. */
import type { JointKind, Observation, Units } from "../api/types";
import { numberIn, scaled, vectorIn } from "./entered";
import { factors, positionIn } from "./units";
import type { Vector } from "./vector";

/** A posture with its load: joints in rad or m, force in N. */
export interface Stand {
  joints: number[];
  force: Vector;
  anchor: number | null;
}

/** What is typed for a target, in mm. */
export interface Typed {
  unloaded: string;
  loaded: string;
}

export type Rows = Record<string, Typed>;

/** The factor from SI to a set's unit of a joint. */
const perJoint = (units: Units, kind: JointKind | undefined): number => {
  const { angle, length } = factors(units);
  return 1 / (kind === "prismatic" ? length : angle);
};

/** The first target whose numbers are missing or cannot be read; null if there is none. Blank ones are left out. */
export function unread(rows: Rows, unloadedOnly: boolean): string | null {
  const complete = ({ unloaded, loaded }: Typed) => vectorIn(unloaded) && (unloadedOnly || vectorIn(loaded));
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
  const { length, force: newtons } = factors(units);
  const place = (typed: string) => vectorIn(typed)?.map((value) => scaled(value, 1e-3 / length)) ?? null;
  const readings = Object.entries(rows)
    .filter(([, { unloaded }]) => unloaded.trim())
    .map(([target, { unloaded, loaded }]) => ({
      target,
      unloaded: place(unloaded),
      ...(unloadedOnly ? {} : { loaded: place(loaded) }),
    }));
  return {
    label,
    joints: joints.map((value, i) => scaled(value, perJoint(units, kinds[i]))),
    force: force.map((part) => scaled(part, 1 / newtons)),
    readings,
  } as unknown as Observation;
}

/** Where an observation was read, back in SI. */
export function standOf({ joints, force }: Observation, units: Units, kinds: readonly JointKind[]): Stand {
  return {
    joints: joints.map((value, i) => value / perJoint(units, kinds[i])),
    force: force.map((part) => part * factors(units).force) as unknown as Vector,
    anchor: null,
  };
}

const LENGTHS = ["unloaded", "loaded", "deflection", "displacement", "sigma"] as const;

/** An observation of a file in the units of the set. */
export function inUnits(observation: Observation, from: Units, to: Units, kinds: readonly JointKind[]): Observation {
  const [a, b] = [factors(from), factors(to)];
  const length = a.length / b.length;
  const each = <Value>(value: Value, factor: number): Value =>
    (Array.isArray(value)
      ? value.map((part) => each(part, factor))
      : typeof value === "number" && factor !== 1
        ? scaled(value, factor)
        : value) as Value;
  return {
    ...observation,
    joints: observation.joints.map((value, i) => each(value, perJoint(to, kinds[i]) / perJoint(from, kinds[i]))),
    force: each(observation.force, a.force / b.force),
    moment: each(observation.moment, a.moment / b.moment),
    load_point: each(observation.load_point, length),
    readings: observation.readings.map((reading) => ({
      ...reading,
      ...Object.fromEntries(LENGTHS.map((name) => [name, each(reading[name], length)])),
      unloaded_covariance: each(reading.unloaded_covariance, length ** 2),
      loaded_covariance: each(reading.loaded_covariance, length ** 2),
    })),
  };
}

/** Joints as typed, in degrees and mm, and a force in N; null if a number is missing. */
export function standTyped(joints: string, force: string, kinds: readonly JointKind[]): Stand | null {
  const angles = joints
    .trim()
    .split(/[\s;]+|,\s+/)
    .map(numberIn);
  const along = vectorIn(force);
  if (!along || angles.length !== kinds.length || !angles.every((value) => value !== null && Number.isFinite(value)))
    return null;
  return { joints: angles.map((value, i) => positionIn(value as number, kinds[i])), force: along, anchor: null };
}

/**
 * The rows with a pasted text in them: one line fills the box at `target`, a block the targets from there on, or those
 * that its lines begin with. Six numbers of a line fill both columns. Null where it is one box's text.
 */
export function pasted(rows: Rows, target: string, column: keyof Typed, clipboard: string): Rows | null {
  const names = Object.keys(rows);
  const lines = clipboard.split(/\r?\n/).filter((line) => line.trim());
  let at = names.indexOf(target);
  const filled: Rows = { ...rows };
  let several = lines.length > 1;
  for (const line of lines) {
    const words = line.trim().split(/[\s;]+|,\s+/);
    const named = names.includes(words[0] ?? "") && words.length > 3;
    const numbers = words.slice(named ? 1 : 0).filter((word) => Number.isFinite(numberIn(word) ?? Number.NaN));
    const name = named ? (words[0] as string) : names[at];
    if (name === undefined || numbers.length < 3) continue;
    at = names.indexOf(name) + 1;
    several ||= named || numbers.length >= 6;
    const before = filled[name] as Typed;
    filled[name] =
      numbers.length >= 6
        ? { unloaded: numbers.slice(0, 3).join(" "), loaded: numbers.slice(3, 6).join(" ") }
        : { ...before, [column]: numbers.slice(0, 3).join(" ") };
  }
  return several ? filled : null;
}

/** A label that nobody has taken: `wanted`, or the next number of its kind. */
export function freeLabel(wanted: string, taken: Set<string>): string {
  let label = wanted;
  for (let number = taken.size + 1; taken.has(label); number++) label = `m${String(number).padStart(2, "0")}`;
  return label;
}

/** A table without the rows whose readings are all still blank, as in a plan's list that is filled in part. */
export function filledRows(table: string): string {
  const [head = "", ...rows] = table.split(/\r?\n/);
  const mark = [";", "\t", ","].find((each) => head.includes(each)) ?? ",";
  const columns = head.split(mark).flatMap((name, i) => (/\b(unloaded|loaded)\b/i.test(name) ? [i] : []));
  const blank = (row: string) => columns.every((i) => !row.split(mark)[i]?.trim());
  return [head, ...rows.filter((row) => columns.length === 0 || row.includes('"') || !blank(row))].join("\n");
}
