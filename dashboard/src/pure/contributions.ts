/**
 * What each joint contributes to the deflection, from the API's data alone.
 *
 * Joint j is twisted by τ_j = a_j · ((p_W − o_j) × F + M), bends by c_j τ_j and moves a target at p by
 * c_j τ_j a_j × (p − o_j): the columns of the model in docs/method.md, axes of R0 and SI throughout.
 */
import type { JointResult, MeasurementSet, Observation, Posture } from "../api/types";
import { factors } from "./units";
import { add, cross, dot, fromFlange, norm, subtract, times, turned, type Vector } from "./vector";

/** Where the load acts and what it is, R0, SI. */
export interface Load {
  point: Vector;
  force: Vector;
  moment: Vector;
}

/** One target of an observation: where it is unloaded and what each joint moves it by [m]. */
export interface Moved {
  observation: string;
  target: string;
  place: Vector;
  byJoint: Vector[];
}

/** The share of each joint in the mean predicted deflection, along it. */
export interface Share {
  name: string;
  share: number;
  mean: number;
}

export function loadOf(set: MeasurementSet, observation: Observation, posture: Posture): Load {
  const unit = factors(set.units);
  const inFlange = observation.load_point ?? set.load_point ?? [0, 0, 0];
  const axes = set.frame?.forces === "tracker" ? set.resolved_frame?.rotation : undefined;
  const inBase = (vector: Vector): Vector => (axes ? turned(axes, vector) : vector);
  return {
    point: fromFlange(posture.flange_origin, posture.flange_axes, times(inFlange, unit.length)),
    force: inBase(times(observation.force, unit.force)),
    moment: inBase(times(observation.moment ?? [0, 0, 0], unit.moment)),
  };
}

/** Where the targets are before the load, R0 [m]: as read, or by the model where only a deflection is known. */
export function placesOf(set: MeasurementSet, observation: Observation, posture: Posture): Map<string, Vector> {
  const { length } = factors(set.units);
  const frame = set.resolved_frame;
  const places = new Map<string, Vector>();
  for (const { target, unloaded } of observation.readings) {
    const stated = set.flange_targets?.[target];
    const onFlange = stated ? times(stated, length) : frame?.flange_targets[target];
    if (unloaded) {
      const read = times(unloaded, length);
      places.set(target, frame ? add(frame.translation, turned(frame.rotation, read)) : read);
    } else if (onFlange) places.set(target, fromFlange(posture.flange_origin, posture.flange_axes, onFlange));
  }
  return places;
}

/** What each joint moves each target by. Joints without a compliance count as rigid. */
export function contributions(set: MeasurementSet, postures: Posture[], joints: JointResult[]): Moved[] {
  return set.observations.flatMap((observation, i) => {
    const posture = postures[i];
    if (!posture) return [];
    const load = loadOf(set, observation, posture);
    return [...placesOf(set, observation, posture)].map(([target, place]) => ({
      observation: observation.label,
      target,
      place,
      byJoint: joints.map((joint, j) => moved(posture, j, joint.compliance ?? 0, load, place)),
    }));
  });
}

function moved(posture: Posture, j: number, compliance: number, load: Load, place: Vector): Vector {
  const [origin, axis] = [posture.joint_origins[j], posture.joint_axes[j]];
  if (!origin || !axis) return [0, 0, 0];
  const torque = dot(axis, add(cross(subtract(load.point, origin), load.force), load.moment));
  return times(cross(axis, subtract(place, origin)), compliance * torque);
}

/** Each joint's contribution along the predicted deflection, as a share of its mean length; they add up to one. */
export function shares(all: Moved[], names: string[]): Share[] {
  const along = names.map(() => 0);
  let total = 0;
  for (const { byJoint } of all) {
    const whole = byJoint.reduce(add, [0, 0, 0]);
    const length = norm(whole);
    total += length;
    byJoint.forEach((part, j) => (along[j] = (along[j] ?? 0) + (length > 0 ? dot(part, whole) / length : 0)));
  }
  return names.map((name, j) => {
    const sum = along[j] ?? 0;
    return { name, share: total > 0 ? sum / total : 0, mean: all.length > 0 ? sum / all.length : 0 };
  });
}
