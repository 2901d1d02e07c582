/** Stiffnesses: the units that the page shows, the digits that their uncertainty allows, and what is said of them in words. */
import type { JointKind, Units, JointResult, Usability } from "../api/types";
import { text } from "../words";
import { type Ends, type ShownEstimate, shownEstimate } from "./estimate";
import { fixed, significant } from "./format";

export type StiffnessUnit = "MNm" | "NmArcmin";

interface Unit {
  /** Of a stiffness in N·m/rad. */
  factor: number;
  label: string;
  /** As the service calls it. */
  name: string;
  /** In the heading of a CSV column. */
  column: string;
}

const DEGREE = Math.PI / 180;

/** Units people choose from: as the literature prints, and as data sheets of gearboxes do. */
export const STIFFNESS_UNITS: Record<StiffnessUnit, Unit> = {
  MNm: { factor: 1e-6, label: "10⁶ N·m/rad", name: "MNm/rad", column: "1e6 N.m/rad" },
  NmArcmin: { factor: DEGREE / 60, label: "N·m/arcmin", name: "Nm/arcmin", column: "N.m/arcmin" },
};

const PER_MICRON: Unit = { factor: 1e-6, label: "N/µm", name: "N/um", column: "N/um" };

/** The unit of joints of a kind. */
export const unitOf = (unit: StiffnessUnit, kind: JointKind = "revolute"): Unit =>
  kind === "prismatic" ? PER_MICRON : STIFFNESS_UNITS[unit];

/** A number with its unit: 80 · 10⁶ N·m/rad. */
export const withUnit = (shown: string, label: string): string =>
  `${shown}${label.startsWith("10") ? " ·" : ""} ${label}`.trimEnd();

/** The labels of the units of some joints. */
export const labelOf = (unit: StiffnessUnit, kinds: readonly JointKind[], part: "label" | "column" = "label"): string =>
  [...new Set(kinds.length > 0 ? kinds : (["revolute"] as const))].map((kind) => unitOf(unit, kind)[part]).join(", ");

export const UNIT_NAMES = Object.keys(STIFFNESS_UNITS) as StiffnessUnit[];

/** A stiffness [N·m/rad, of a prismatic joint N/m] in a unit. */
export function inUnit(stiffness: number, unit: StiffnessUnit, kind?: JointKind): number {
  return unitOf(unit, kind).factor * stiffness;
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
  const [low = null, high = null] = interval.map((end) => maybeInUnit(end, unit, kind));
  return [low, high];
}

const LBF = 4.4482216152605;

/** Factors to SI of the words for units, by what they measure. */
export const UNITS = {
  length: { m: 1, mm: 1e-3 },
  angle: { rad: 1, deg: DEGREE },
  force: { N: 1, kN: 1e3, kgf: 9.80665, lbf: LBF, kg: 9.80665 },
  moment: {
    "N.m": 1,
    "N.mm": 1e-3,
    "kN.m": 1e3,
    "kgf.m": 9.80665,
    "lbf.m": LBF,
    "lbf.ft": 0.3048 * LBF,
    "lbf.in": 0.0254 * LBF,
  },
} as const;

/** Factors to SI of a file's units. */
export function factors(units: Units): { length: number; angle: number; force: number; moment: number } {
  const [length, angle, force] = [UNITS.length[units.length], UNITS.angle[units.angle], UNITS.force[units.force]];
  return { length, angle, force, moment: units.moment ? UNITS.moment[units.moment] : force * length };
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

export type Verdict = "firm" | "fair" | "rough" | "unrated" | "vague" | "lower_limit" | "negative" | "unobservable";

/** Relative half width of the interval below which a stiffness is called firm, fair. */
const FIRM = 0.05;
const FAIR = 0.2;

/** Standard uncertainty over compliance above which a value without interval says hardly anything. */
const VAGUE = 0.5;

export function verdictOf(joint: JointResult): Verdict {
  if (joint.status === "not_observable" || joint.compliance === null) return "unobservable";
  if (joint.compliance < 0) return "negative";
  const interval = joint.stiffness_interval;
  if (joint.stiffness === null) return "lower_limit";
  if (!interval) return (joint.standard_uncertainty ?? 0) > VAGUE * joint.compliance ? "vague" : "unrated";
  if (interval[1] === null) return "lower_limit";
  const halfWidth = (interval[1] - interval[0]) / 2 / joint.stiffness;
  return halfWidth <= FIRM ? "firm" : halfWidth <= FAIR ? "fair" : "rough";
}

/** Whether a result that is not to be used leaves a stiffness open: its model is refuted, and gives no limit. */
export const isRefuted = (joint: JointResult): boolean =>
  joint.verdict === "do_not_use" &&
  joint.status !== "not_observable" &&
  (joint.stiffness === null || joint.stiffness_interval?.[1] === null);

/** Stiffer than this, at the run's confidence; null where nothing is known. */
export function lowerLimit(joint: JointResult): number | null {
  if (isRefuted(joint)) return null;
  return joint.stiffness_at_least ?? joint.stiffness_interval?.[0] ?? null;
}

/** The assessment of a joint where its status does not say it: of an identified one, or of one not to be used. */
export function capOf({ status, verdict }: JointResult): Usability | null {
  const told = status === "identified" ? "use" : status === "not_observable" ? "do_not_use" : "use_with_care";
  return verdict === told ? null : verdict;
}

/** The stiffness of a joint in a unit; of a prismatic joint with its unit. */
export function shownStiffness(joint: JointResult, unit: StiffnessUnit): ShownEstimate {
  const { kind, stiffness, compliance, stiffness_interval: interval, verdict } = joint;
  const { label } = unitOf(unit, kind);
  const unusable = verdict === "do_not_use";
  const ends = interval ? intervalIn(interval, unit, kind) : endsAround(joint, unit);
  const shown = shownEstimate(isRefuted(joint) ? null : maybeInUnit(stiffness, unit, kind), ends, unusable);
  const excludes = !interval && ends !== null && straddles(joint);
  const limit = verdictOf(joint) === "lower_limit" ? lowerLimit(joint) : null;
  const beside = kind === "prismatic" ? `\u00a0${label}` : "";
  if (limit !== null) return { ...shown, limit: `${limitText(limit, unit, kind)}${beside}` };
  if (compliance === 0 && !isRefuted(joint)) return { ...shown, value: "∞", interval: text.estimate.noInterval };
  if (shown.value === null) return shown;
  const words = excludes && shown.interval !== null ? text.estimate.outside(shown.interval) : shown.interval;
  return { ...shown, value: `${shown.value}${beside}`, interval: words };
}

const straddles = ({ compliance_interval: ends }: JointResult): boolean => !!ends && ends[0] < 0 && ends[1] > 0;

/** The ends of an interval of which a part is negative; where the compliance may be zero, those that the stiffness excludes. */
function endsAround({ kind, compliance_interval: ends }: JointResult, unit: StiffnessUnit): Ends | null {
  if (!ends) return null;
  const { factor } = unitOf(unit, kind);
  const [low, high] = ends.map((end) => (end === 0 ? null : factor / end)) as [number | null, number | null];
  return ends[0] < 0 && ends[1] > 0 ? [low, high] : [high, low];
}

/** Where a stiffness with its interval is drawn on an axis of a unit; null: no number, or no end. */
export interface OnAxis {
  value: number | null;
  low: number | null;
  high: number | null;
}

export function onAxis(
  { stiffness, interval }: { stiffness?: number | null; interval?: readonly [number, number | null] | null },
  unit: StiffnessUnit,
  kind?: JointKind,
): OnAxis {
  const value = maybeInUnit(stiffness, unit, kind);
  const [low, high] = intervalIn(interval, unit, kind);
  return { value, low, high: interval ? high : value };
}

/** A stiffness in words, of which only the size is meant. */
export const roughStiffness = (stiffness: number, unit: StiffnessUnit, kind?: JointKind): string =>
  withUnit(significant(inUnit(stiffness, unit, kind), 2), unitOf(unit, kind).label);

/** A stiffness of a live campaign: with the interval that the service states, grey where it must not be used. */
export const shownWithInterval = (
  stiffness: number | null,
  interval: readonly [number, number | null] | null,
  unit: StiffnessUnit,
  kind?: JointKind,
): ShownEstimate => shownEstimate(maybeInUnit(stiffness, unit, kind), interval && intervalIn(interval, unit, kind));

/** "> 3.1": rounded so that it stays a limit. */
function limitText(limit: number, unit: StiffnessUnit, kind?: JointKind): string {
  const step = 10 ** (Math.floor(Math.log10(limit)) - 1);
  return `> ${significant(inUnit(Math.floor(limit / step + 1e-9) * step, unit, kind), 2)}`;
}

/** A number of an axis of stiffness; the axis stays one of stiffness whatever the unit. */
export function axisStiffness(unit: StiffnessUnit): (stiffness: number) => string {
  return (stiffness) => axisNumber(inUnit(stiffness, unit));
}

const axisNumber = (value: number): string =>
  value >= 1e4 ? significant(value, 2).replace(/\.0$/, "") : String(Number(value.toPrecision(2)));
