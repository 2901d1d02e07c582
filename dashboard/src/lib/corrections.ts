/** Corrections of readings and robots that an assessment suggests. */
import type { Action, MeasurementSet, Robot, RobotDocument } from "../api/types";
import { factors } from "./units";

type Readings = Pick<MeasurementSet, "observations" | "noise" | "load_point" | "flange_targets" | "units" | "frame">;

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
    case "correct_load_point": {
      const moved = (place: Vector) => plus(place, action.correction, factors(set.units).length);
      const observations = set.observations.map((one) => ({
        ...one,
        load_point: one.load_point && moved(one.load_point),
      }));
      return { ...set, observations, load_point: moved(set.load_point ?? [0, 0, 0]) };
    }
    case "correct_force": {
      const { force } = factors(set.units);
      const observations = set.observations.map((one) => ({
        ...one,
        force: plus(one.force, action.correction, force),
      }));
      return { ...set, observations };
    }
    case "convert_units": {
      const { unit } = action;
      if (unit === "m" || unit === "mm") return { ...set, units: { ...set.units, length: unit } };
      if (unit === "deg" || unit === "rad") return { ...set, units: { ...set.units, angle: unit } };
      return unit ? { ...set, units: { ...set.units, force: unit } } : set;
    }
    case "exchange_readings": {
      const observations = set.observations.map((one) => ({
        ...one,
        readings: one.readings.map((reading) => ({
          ...reading,
          unloaded: reading.loaded,
          loaded: reading.unloaded,
          deflection:
            reading.deflection &&
            plus(
              [0, 0, 0],
              reading.deflection.map((x) => -x),
              1,
            ),
        })),
      }));
      return { ...set, observations };
    }
    default:
      return set;
  }
}

type Vector = [number, number, number];

/** A vector in a set's unit, and what is added to it in the SI unit; `unit` is the set's in the SI unit. */
function plus([x, y, z]: Vector, added: number[], unit: number): Vector {
  const [dx = 0, dy = 0, dz = 0] = added;
  return [x + dx / unit, y + dy / unit, z + dz / unit];
}

/** Whether the set states what an action changes: a target's place on the flange, forces in the axes of R0. */
export const exchangeable = ({ flange_targets: places, frame }: Readings, { kind, target }: Action): boolean =>
  kind === "exchange_load_and_target"
    ? target !== null && places?.[target] !== undefined
    : kind !== "correct_force" || !frame;

function exchanged(values: number[], a: number, b: number): number[] {
  const copy = [...values];
  [copy[a], copy[b]] = [values[b] ?? 0, values[a] ?? 0];
  return copy;
}

/** A robot with the joint map that an action suggests. */
export function withJointMap(robot: Robot, { joint_map: matrix, offset }: Action, name: string): RobotDocument {
  return { name, model: robot.model, joint_map: { matrix, offset } } as RobotDocument;
}
