/** Corrections of readings and robots that an assessment suggests. */
import type { Action, MeasurementSet, Robot, RobotDocument } from "../api/types";

type Readings = Pick<MeasurementSet, "observations" | "noise" | "load_point" | "flange_targets">;

/** The readings after an action that changes them. */
export function corrected<Set extends Readings>(set: Set, action: Action, joints: string[]): Set {
  switch (action.kind) {
    case "omit_noise":
      return { ...set, noise: null };
    case "exchange_columns": {
      const [a, b] = action.joints.map((name) => joints.indexOf(name));
      if (a === undefined || b === undefined) return set;
      const observations = set.observations.map((one) => ({ ...one, joints: exchanged(one.joints, a, b) }));
      return { ...set, observations };
    }
    case "exchange_load_and_target": {
      const place = action.target === null ? undefined : set.flange_targets?.[action.target];
      if (action.target === null || !place) return set;
      const load = set.load_point ?? [0, 0, 0];
      const observations = set.observations.map((one) => ({ ...one, load_point: null }));
      return {
        ...set,
        observations,
        load_point: place,
        flange_targets: { ...set.flange_targets, [action.target]: load },
      };
    }
    default:
      return set;
  }
}

/** Whether the set states what an action exchanges: a target's place on the flange. */
export const exchangeable = ({ flange_targets: places }: Readings, { kind, target }: Action): boolean =>
  kind !== "exchange_load_and_target" || (target !== null && places?.[target] !== undefined);

function exchanged(values: number[], a: number, b: number): number[] {
  const copy = [...values];
  [copy[a], copy[b]] = [values[b] ?? 0, values[a] ?? 0];
  return copy;
}

/** A robot with the joint map that an action suggests. */
export function withJointMap(robot: Robot, { joint_map: matrix, offset }: Action, name: string): RobotDocument {
  return { name, model: robot.model, joint_map: { matrix, offset } } as RobotDocument;
}
