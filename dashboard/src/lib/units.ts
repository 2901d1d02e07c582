/** Units the page shows, and those a file may come in. */
import type { JointKind, Units } from "../api/types";
import { fixed } from "./format";

export type StiffnessUnit = "MNm" | "kNmDeg" | "NmArcmin" | "Nm" | "compliance";

interface Unit {
  /** Of a stiffness in N·m/rad; of its inverse where `inverse`. */
  factor: number;
  inverse?: true;
  label: string;
  /** As the service calls it. */
  name: string;
  /** In the heading of a CSV column. */
  column: string;
}

const DEGREE = Math.PI / 180;

/** Units people choose from: as the literature prints, per angle as data sheets do, and the compliance. */
export const STIFFNESS_UNITS: Record<StiffnessUnit, Unit> = {
  MNm: { factor: 1e-6, label: "10⁶ N·m/rad", name: "MNm/rad", column: "1e6 N.m/rad" },
  kNmDeg: { factor: DEGREE / 1e3, label: "kN·m/°", name: "kNm/deg", column: "kN.m/deg" },
  NmArcmin: { factor: DEGREE / 60, label: "N·m/arcmin", name: "Nm/arcmin", column: "N.m/arcmin" },
  Nm: { factor: 1, label: "N·m/rad", name: "Nm/rad", column: "N.m/rad" },
  compliance: { factor: 1e6, inverse: true, label: "µrad/(N·m)", name: "urad/Nm", column: "urad/(N.m)" },
};

const PER_MICRON: Unit = { factor: 1e-6, label: "N/µm", name: "N/um", column: "N/um" };

/** The same of prismatic joints: a force per length. */
const OF_PRISMATIC: Record<StiffnessUnit, Unit> = {
  MNm: PER_MICRON,
  kNmDeg: PER_MICRON,
  NmArcmin: PER_MICRON,
  Nm: { factor: 1, label: "N/m", name: "N/m", column: "N/m" },
  compliance: { factor: 1e6, inverse: true, label: "µm/N", name: "um/N", column: "um/N" },
};

/** The unit of joints of a kind. */
export const unitOf = (unit: StiffnessUnit, kind: JointKind = "revolute"): Unit =>
  (kind === "prismatic" ? OF_PRISMATIC : STIFFNESS_UNITS)[unit];

/** The labels of the units of some joints. */
export const labelOf = (unit: StiffnessUnit, kinds: readonly JointKind[], part: "label" | "column" = "label"): string =>
  [...new Set(kinds.length > 0 ? kinds : (["revolute"] as const))].map((kind) => unitOf(unit, kind)[part]).join(", ");

export const UNIT_NAMES = Object.keys(STIFFNESS_UNITS) as StiffnessUnit[];

/** The unit in which stiffnesses are typed: the page's, or the literature's where that is a compliance. */
export const formUnit = (unit: StiffnessUnit): Unit => STIFFNESS_UNITS[STIFFNESS_UNITS[unit].inverse ? "MNm" : unit];

/** A stiffness [N·m/rad, of a prismatic joint N/m] in a unit. */
export function inUnit(stiffness: number, unit: StiffnessUnit, kind?: JointKind): number {
  const { factor, inverse } = unitOf(unit, kind);
  return inverse ? factor / stiffness : factor * stiffness;
}

/** The same of what may be missing. */
export const maybeInUnit = (
  stiffness: number | null | undefined,
  unit: StiffnessUnit,
  kind?: JointKind,
): number | null => (stiffness === null || stiffness === undefined ? null : inUnit(stiffness, unit, kind));

/** An interval of a stiffness in a unit, low end first; null for an end that is open. */
export function intervalIn(
  interval: readonly [number, number | null] | null | undefined,
  unit: StiffnessUnit,
  kind?: JointKind,
): [number | null, number | null] {
  if (!interval) return [null, null];
  const ends: [number | null, number | null] = [
    maybeInUnit(interval[0], unit, kind),
    maybeInUnit(interval[1], unit, kind),
  ];
  return STIFFNESS_UNITS[unit].inverse ? [ends[1] ?? 0, ends[0]] : ends;
}

/** A small change of a stiffness in a unit, to first order. */
export function changeIn(change: number, stiffness: number, unit: StiffnessUnit, kind?: JointKind): number {
  const { factor, inverse } = unitOf(unit, kind);
  return inverse ? (factor * change) / stiffness ** 2 : factor * change;
}

const LENGTH = { m: 1, mm: 1e-3 } as const;
const ANGLE = { rad: 1, deg: DEGREE } as const;
const FORCE = { N: 1, kN: 1e3, kgf: 9.80665, kg: 9.80665 } as const;
const MOMENT = { "N.m": 1, "N.mm": 1e-3, "kN.m": 1e3, "kgf.m": 9.80665 } as const;

/** Factors to SI of a file's units. */
export function factors(units: Units): { length: number; angle: number; force: number; moment: number } {
  const length = LENGTH[units.length];
  const force = FORCE[units.force];
  return { length, angle: ANGLE[units.angle], force, moment: units.moment ? MOMENT[units.moment] : force * length };
}

export const degrees = (radians: number): number => radians / DEGREE;
export const radians = (angle: number): number => angle * DEGREE;

/** The position of a joint [rad or m] as people see it: in degrees, of a prismatic joint in millimetres. */
export const position = (value: number, kind: JointKind = "revolute"): number =>
  kind === "prismatic" ? 1e3 * value : degrees(value);

/** The same back, in rad or m. */
export const positionIn = (shown: number, kind: JointKind = "revolute"): number =>
  kind === "prismatic" ? shown / 1e3 : radians(shown);

export const positionUnit = (kind: JointKind = "revolute"): string => (kind === "prismatic" ? "\u00a0mm" : "°");

/** A posture in words, a unit beside each joint where one is prismatic. */
export function postureText(joints: readonly number[], kinds: readonly JointKind[], decimals: number): string {
  const shown = joints.map((value, i) => fixed(position(value, kinds[i]), decimals));
  if (!kinds.includes("prismatic")) return `${shown.join(", ")} °`;
  return shown.map((value, i) => `${value}${positionUnit(kinds[i])}`).join(", ");
}
