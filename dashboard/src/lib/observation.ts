/** An observation in other units: that of a file in the units of a set, and back in SI. */
import type { JointKind, Observation, Units } from "../api/types";
import { sized } from "./schema";
import { factors } from "./stiffness";
import type { Vector } from "./vector";

/** A posture with its load: joints in rad or m, force in N. */
export interface Stand {
  joints: number[];
  force: Vector;
  anchor: number | null;
}

export const SI: Units = { length: "m", angle: "rad", force: "N", moment: null };

/** The factor from SI to a set's unit of a joint. */
const perJoint = (units: Units, kind: JointKind | undefined): number => {
  const { angle, length } = factors(units);
  return 1 / (kind === "prismatic" ? length : angle);
};

/** Where an observation was read, back in SI. */
export function standOf(observation: Observation, units: Units, kinds: readonly JointKind[]): Stand {
  const { joints, force } = inUnits(observation, units, SI, kinds);
  return { joints, force: force as unknown as Vector, anchor: null };
}

const LENGTHS = ["unloaded", "loaded", "unloaded_after", "deflection", "displacement", "sigma"] as const;

/** An observation of a file in the units of the set. */
export function inUnits(observation: Observation, from: Units, to: Units, kinds: readonly JointKind[]): Observation {
  const [a, b] = [factors(from), factors(to)];
  const length = a.length / b.length;
  return {
    ...observation,
    joints: observation.joints.map((value, i) => sized(value, perJoint(to, kinds[i]) / perJoint(from, kinds[i]))),
    force: sized(observation.force, a.force / b.force),
    moment: sized(observation.moment, a.moment / b.moment),
    load_point: sized(observation.load_point, length),
    readings: observation.readings.map((reading) => ({
      ...reading,
      ...Object.fromEntries(LENGTHS.map((name) => [name, sized(reading[name], length)])),
      unloaded_covariance: sized(reading.unloaded_covariance, length ** 2),
      loaded_covariance: sized(reading.loaded_covariance, length ** 2),
    })),
  } as Observation;
}
