/** What is doubtful in a weight step while it is read, by the typed angles and the plan alone: nothing is sent. */
import type { PlannedReading, Posture } from "../../api/types";
import { degrees, radians } from "../../lib/stiffness";
import { bendOf, fromFlange, type Vector } from "../../lib/vector";
import { anglesOf, type Place, placesOf, SIDES, STATES, type StepState, type Typed } from "./step";

export type DoubtKind = "unit" | "posture" | "twist" | "against" | "anew" | "sides" | "off";

/** A doubt about the readings of a joint. */
export interface Doubt {
  kind: DoubtKind;
  joint: string;
  /** The postures in which it shows; empty if it shows in all of them together. */
  postures: string[];
  /** How large it is: a factor of a unit, an angle [°] of a posture, else an angle [µrad]. */
  size: number;
}

/** A planned posture as the checks need it. */
export interface Checked {
  label: string;
  /** Positions of all joints as the controller shows them [°]. */
  angles: number[];
  /** Torques with which the motors hold the load [N·m]; null until the arm's axes are known. */
  torques: number[] | null;
}

/** Angles [°] that the service, too, finds too large: of a twist that no gearbox survives, and of another posture. */
const GREATEST_TWIST = degrees(20e-3);
const OTHER_POSTURE = degrees(5e-3);
/** Twist [°] that no torque explains, from which an encoder was referenced anew. */
const GREATEST_OFFSET = degrees(200e-6);
/** Range of planned angles [°] from which the unit of typed ones shows, and the factors between which it is right. */
const LEAST_RANGE = 5;
const RIGHT_UNIT = [0.5, 2] as const;
/** Postures from which the median of a joint counts. */
const OF_MEDIAN = 3;
/** Student's quantiles of 0.9995 by degrees of freedom, from 1; a false alarm in 1,000. */
const FAR = [636.6, 31.6, 12.92, 8.61, 6.87, 5.96, 5.41, 5.04, 4.78, 4.59, 4.44, 4.32];
const far = (freedom: number): number => FAR[Math.min(freedom, FAR.length) - 1] ?? Number.POSITIVE_INFINITY;
/** Digits to which angles are rounded [°]: a noise of zero is none that can be judged by. */
const LEAST_NOISE = 1e-5;

const mean = (values: number[]): number => values.reduce((sum, value) => sum + value, 0) / values.length;
const range = (values: number[]): number => Math.max(...values) - Math.min(...values);
const largest = (values: number[]): number => Math.max(...values.map(Math.abs));
const toMicro = (angle: number): number => 1e6 * radians(angle);

function median(values: number[]): number {
  const sorted = values.toSorted((a, b) => a - b);
  const middle = sorted.length / 2;
  return mean(sorted.slice(Math.ceil(middle) - 1, Math.floor(middle) + 1));
}

/** A straight line through points, and the noise of a point. */
interface Line {
  offset: number;
  slope: number;
  noise: number;
  slopeUncertainty: number;
  /** Variance of the line at a place, relative to that of a point. */
  varianceAt: (x: number) => number;
}

/** The line of least squares; null for fewer than three points, or for points of one place. */
function lineThrough(x: number[], y: number[]): Line | null {
  const [centre, level] = [mean(x), mean(y)];
  const spread = x.reduce((sum, at) => sum + (at - centre) ** 2, 0);
  if (x.length < OF_MEDIAN || spread <= 1e-9 * largest(x) ** 2) return null;
  const slope = x.reduce((sum, at, i) => sum + (at - centre) * ((y[i] ?? 0) - level), 0) / spread;
  const squares = x.reduce((sum, at, i) => sum + ((y[i] ?? 0) - level - slope * (at - centre)) ** 2, 0);
  const noise = Math.max(Math.sqrt(squares / (x.length - 2)), LEAST_NOISE);
  return {
    offset: level - slope * centre,
    slope,
    noise,
    slopeUncertainty: noise / Math.sqrt(spread),
    varianceAt: (at) => 1 / x.length + (at - centre) ** 2 / spread,
  };
}

/** A planned posture with the torques of the load about its joints. */
export function checkedOf(planned: PlannedReading, posture: Posture | undefined, loadPoint: Vector): Checked {
  const checked = { label: planned.label, angles: planned.joints.map(degrees), torques: null };
  if (!posture) return checked;
  const point = fromFlange(posture.flange_origin, posture.flange_axes, loadPoint);
  const ones = planned.joints.map(() => 1);
  const byLoad = bendOf(posture, ones, { point, force: planned.force });
  return { ...checked, torques: byLoad.map((torque) => -torque) };
}

/** One reading of a joint [°]. */
interface Read {
  posture: Checked;
  place: Place;
  motor: number;
  twist: number;
}

function readingsOf(typed: Typed, postures: readonly Checked[], joint: string): Read[] {
  return postures.flatMap((posture) =>
    STATES.flatMap((state) =>
      placesOf(posture.label, [joint], state).flatMap((place) => {
        const angles = anglesOf(typed, place);
        return angles ? [{ posture, place, motor: angles.motor, twist: angles.motor - angles.link }] : [];
      }),
    ),
  );
}

/** What is doubtful so far; `names` are all joints of the robot, `joints` those that are read. */
export function doubtsOf(
  typed: Typed,
  postures: readonly Checked[],
  names: readonly string[],
  joints: readonly string[],
): Doubt[] {
  return joints.flatMap((joint) => {
    const of = names.indexOf(joint);
    const read = readingsOf(typed, postures, joint);
    const unit = doubtOfUnit(read, joint, of);
    if (unit) return [unit]; // nothing else can be judged
    const twist = doubtOfTwist(read, joint);
    const before = [doubtOfPosture(read, joint, of), twist, doubtOfSides(read, joint)];
    return [...before, ...(twist ? [] : doubtsOfSteps(read, joint, of))].filter((doubt) => doubt !== null);
  });
}

const planned = ({ posture }: Read, of: number): number => posture.angles[of] ?? 0;

/** The line of the motor's angles over the planned ones; null as long as these differ too little. */
function lineOfMotor(read: Read[], of: number): Line | null {
  const angles = read.map((each) => planned(each, of));
  if (read.length === 0 || range(angles) < LEAST_RANGE) return null;
  return lineThrough(
    angles,
    read.map(({ motor }) => motor),
  );
}

/** Motor angles that change by another factor than those of the plan: radians, or angles before the gear. */
function doubtOfUnit(read: Read[], joint: string, of: number): Doubt | null {
  const line = lineOfMotor(read, of);
  if (!line) return null;
  const factor = Math.abs(line.slope);
  const isRight = factor > RIGHT_UNIT[0] && factor < RIGHT_UNIT[1];
  return isRight ? null : { kind: "unit", joint, postures: [], size: factor };
}

/** Motors that stand elsewhere than in the other postures; a zero and a sense of their own do not matter. */
function doubtOfPosture(read: Read[], joint: string, of: number): Doubt | null {
  const sense = Math.sign(lineOfMotor(read, of)?.slope ?? 1);
  const unloaded = read.filter(({ place }) => place.state === "unloaded");
  const differences = unloaded.map((each) => each.motor - sense * planned(each, of));
  if (new Set(unloaded.map(({ posture }) => posture)).size < OF_MEDIAN) return null;
  return doubtAbout("posture", joint, unloaded, differences, OTHER_POSTURE, 1);
}

/** Twists that no gearbox survives: another unit or sign of the link's angle, or a wrong digit. */
function doubtOfTwist(read: Read[], joint: string): Doubt | null {
  const twists = read.map(({ twist }) => twist);
  return doubtAbout("twist", joint, read, twists, GREATEST_TWIST, toMicro(1));
}

/** Values that are farther than a limit from their median. */
function doubtAbout(
  kind: DoubtKind,
  joint: string,
  read: Read[],
  values: number[],
  limit: number,
  unit: number,
): Doubt | null {
  if (values.length === 0) return null;
  const usual = median(values);
  const off = values.map((value) => Math.abs(value - usual));
  const wrong = read.filter((_, i) => (off[i] ?? 0) > limit);
  if (wrong.length === 0) return null;
  const postures = [...new Set(wrong.map(({ posture }) => posture.label))];
  return { kind, joint, postures, size: unit * Math.max(...off) };
}

/** Sides that are exchanged: in a gearbox with lost motion the motor leads. */
function doubtOfSides(read: Read[], joint: string): Doubt | null {
  const pairs = read.flatMap((plus) => {
    const minus = read.find(({ place }) => isOtherSide(plus.place, place));
    return plus.place.side === SIDES[0] && minus ? [plus.twist - minus.twist] : [];
  });
  if (pairs.length < 2) return null;
  const lost = mean(pairs);
  const squares = pairs.reduce((sum, value) => sum + (value - lost) ** 2, 0);
  const uncertainty = Math.max(Math.sqrt(squares / (pairs.length - 1)), LEAST_NOISE) / Math.sqrt(pairs.length);
  const areExchanged = lost < -far(pairs.length - 1) * uncertainty;
  return areExchanged ? { kind: "sides", joint, postures: [], size: toMicro(-lost) } : null;
}

const isOtherSide = (one: Place, other: Place): boolean =>
  one.posture === other.posture && one.state === other.state && one.side !== other.side;

/** The twist with the load less that without it, in one posture. */
interface Step {
  label: string;
  torque: number;
  step: number;
}

function stepsOf(read: Read[], of: number): Step[] {
  const postures = [...new Set(read.map(({ posture }) => posture))];
  return postures.flatMap((posture) => {
    const [unloaded, loaded] = STATES.map((state) => twistsIn(read, posture, state));
    const isWhole = unloaded?.length === SIDES.length && loaded?.length === SIDES.length;
    if (!isWhole || !posture.torques) return [];
    return [{ label: posture.label, torque: posture.torques[of] ?? 0, step: mean(loaded) - mean(unloaded) }];
  });
}

const twistsIn = (read: Read[], posture: Checked, state: StepState): number[] =>
  read.filter((each) => each.posture === posture && each.place.state === state).map(({ twist }) => twist);

/** Steps against the torque, steps without a torque, and single steps off the others. */
function doubtsOfSteps(read: Read[], joint: string, of: number): Doubt[] {
  const steps = stepsOf(read, of);
  const line = lineOf(steps);
  if (!line) return [];
  const freedom = steps.length - 2;
  const greatest = largest(steps.map(({ step }) => step));
  if (line.slope < -far(freedom) * line.slopeUncertainty)
    return [{ kind: "against", joint, postures: [], size: toMicro(greatest) }];
  const off = steps.flatMap((step, i) => doubtOfStep(step, steps.toSpliced(i, 1), joint));
  if (off.length > 0) return off;
  const uncertainty = line.noise * Math.sqrt(line.varianceAt(0));
  const isAnew = Math.abs(line.offset) > GREATEST_OFFSET + far(freedom) * uncertainty;
  return isAnew ? [{ kind: "anew", joint, postures: [], size: toMicro(line.offset) }] : [];
}

const lineOf = (steps: Step[]): Line | null =>
  lineThrough(
    steps.map(({ torque }) => torque),
    steps.map(({ step }) => step),
  );

/** A step that the line through the others does not expect. */
function doubtOfStep({ label, torque, step }: Step, others: Step[], joint: string): Doubt[] {
  const line = lineOf(others);
  if (!line) return [];
  const difference = step - line.offset - line.slope * torque;
  const uncertainty = line.noise * Math.sqrt(1 + line.varianceAt(torque));
  const isFar = Math.abs(difference) > far(others.length - 2) * uncertainty;
  return isFar ? [{ kind: "off", joint, postures: [label], size: toMicro(difference) }] : [];
}
