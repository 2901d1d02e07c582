/** A weight step that is read by hand: what is typed, what is missing, and the request that it becomes. */
import type {
  EncoderAngles,
  GearboxRequest,
  JointKind,
  PlannedReading,
  StepPosture,
  TwistReading,
} from "../../api/types";
import { numberIn } from "../../lib/schema";
import { degrees } from "../../lib/stiffness";

export const STATES = ["unloaded", "loaded"] as const;
export const SIDES = ["+", "-"] as const;
export const ENCODERS = ["motor", "link"] as const;

export type StepState = (typeof STATES)[number];
export type Side = (typeof SIDES)[number];
export type Encoder = (typeof ENCODERS)[number];

/** Postures with a reading of one joint in both states, from which on a result can be determined. */
export const LEAST_POSTURES = 4;

/** What the names begin with under which a device keeps the readings of plans, by the id of the plan. */
export const KEPT = "step.";

/** Units of the request: angles as a controller shows them, lengths as a plan states them. */
export const UNITS = { length: "m", angle: "deg" } as const;

/** Where one reading belongs: both angles of a joint in a posture, from one side, in one state. */
export interface Place {
  posture: string;
  joint: string;
  side: Side;
  state: StepState;
}

/** What was typed [°], by place and encoder. */
export type Typed = Record<string, string>;

export const keyOf = ({ posture, joint, side, state }: Place, encoder: Encoder): string =>
  JSON.stringify([posture, joint, side, state, encoder]);

/** The angles of a place; null if one of them is missing or is no number. */
export function anglesOf(typed: Typed, place: Place): EncoderAngles | null {
  const [motor, link] = ENCODERS.map((encoder) => numberIn(typed[keyOf(place, encoder)] ?? ""));
  return Number.isFinite(motor) && Number.isFinite(link) ? ({ motor, link } as EncoderAngles) : null;
}

/** All places of a posture in one state, in the order in which they are read. */
export const placesOf = (posture: string, joints: readonly string[], state: StepState): Place[] =>
  SIDES.flatMap((side) => joints.map((joint) => ({ posture, joint, side, state })));

/** Those of some places that lack an angle. */
export const missingOf = (typed: Typed, places: readonly Place[]): Place[] =>
  places.filter((place) => anglesOf(typed, place) === null);

/** The readings of a posture that have all four angles. */
function readingsIn(typed: Typed, posture: string, joints: readonly string[]): TwistReading[] {
  return placesOf(posture, joints, "unloaded").flatMap((place) => {
    const { joint, side } = place;
    const unloaded = anglesOf(typed, place);
    const loaded = anglesOf(typed, { ...place, state: "loaded" });
    return unloaded && loaded ? [{ joint, approach: side, unloaded, loaded }] : [];
  });
}

/** The postures that have a reading of a joint with all four angles. */
export function observationsOf(
  typed: Typed,
  planned: readonly Pick<PlannedReading, "label" | "joints">[],
  joints: readonly string[],
  kinds: readonly JointKind[],
): StepPosture[] {
  return planned.flatMap(({ label, joints: positions }) => {
    const readings = readingsIn(typed, label, joints);
    const shown = positions.map((value, i) => (kinds[i] === "prismatic" ? value : degrees(value)));
    return readings.length > 0 ? [{ label, joints: shown, encoder_readings: readings }] : [];
  });
}

/** In how many postures the joint is read that is read in most. */
export function mostRead(observations: readonly StepPosture[]): number {
  const joints = observations.flatMap(({ encoder_readings: readings }) => [
    ...new Set(readings.map(({ joint }) => joint)),
  ]);
  return Math.max(0, ...joints.map((joint) => joints.filter((other) => other === joint).length));
}

/** The request of a weight step of a stored robot. */
export const requestOf = (
  name: string,
  robot: string,
  load: Record<string, unknown>,
  observations: StepPosture[],
): GearboxRequest => ({ name, robot_id: robot, units: UNITS, load, observations }) as unknown as GearboxRequest;
