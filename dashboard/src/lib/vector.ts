/** Three numbers and what is done with them: where loads and targets are (R0, SI), and how an arm bends. */
import type { MeasurementSet, Observation, Posture } from "../api/types";
import { factors } from "./stiffness";

export type Vector = readonly [number, number, number];

export const add = (a: Vector, b: Vector): Vector => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const subtract = (a: Vector, b: Vector): Vector => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const times = (a: Vector, factor: number): Vector => [a[0] * factor, a[1] * factor, a[2] * factor];
export const dot = (a: Vector, b: Vector): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const norm = (a: Vector): number => Math.hypot(a[0], a[1], a[2]);
export const cross = (a: Vector, b: Vector): Vector => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];

/** A vector turned by a matrix, given row by row. */
export const turned = (rows: readonly Vector[], v: Vector): Vector => [
  dot(rows[0] ?? [1, 0, 0], v),
  dot(rows[1] ?? [0, 1, 0], v),
  dot(rows[2] ?? [0, 0, 1], v),
];

/** A point in the flange frame, in R0; `axes` are the flange's axes in R0. */
export function fromFlange(origin: Vector, axes: readonly Vector[], point: Vector): Vector {
  const [x = [1, 0, 0], y = [0, 1, 0], z = [0, 0, 1]] = axes as [Vector, Vector, Vector];
  return add(origin, add(times(x, point[0]), add(times(y, point[1]), times(z, point[2]))));
}

/** Where the load acts and what it is, R0, SI. */
export interface Load {
  point: Vector;
  force: Vector;
}

export function loadOf(set: MeasurementSet, observation: Observation, posture: Posture): Load {
  const unit = factors(set.units);
  const inFlange = observation.load_point ?? set.load_point ?? [0, 0, 0];
  const axes = set.frame?.forces === "tracker" ? set.resolved_frame?.rotation : undefined;
  const inBase = (vector: Vector): Vector => (axes ? turned(axes, vector) : vector);
  return {
    point: fromFlange(posture.flange_origin, posture.flange_axes, times(inFlange, unit.length)),
    force: inBase(times(observation.force, unit.force)),
  };
}

/** Where the targets are before the load, R0 [m]: as read, or by the model where only a deflection is known. */
export function placesOf(set: MeasurementSet, observation: Observation, posture: Posture): Map<string, Vector> {
  const { length } = factors(set.units);
  const frame = set.resolved_frame;
  const places = new Map<string, Vector>();
  for (const { target, unloaded } of observation.readings) {
    const stated = set.flange_targets?.[target];
    const onFlange = stated ? times(stated, length) : set.geometry_targets[target];
    if (unloaded) {
      const read = times(unloaded, length);
      places.set(target, frame ? add(frame.translation, turned(frame.rotation, read)) : read);
    } else if (onFlange) places.set(target, fromFlange(posture.flange_origin, posture.flange_axes, onFlange));
  }
  return places;
}

/** Angles [rad] by which the joints give way: compliance c_j times the torque a_j · ((p − o_j) × F) of the load; of
 * prismatic joints lengths [m]: c_j times the force a_j · F. */
export function bendOf(posture: Posture, compliances: (number | null)[], { point, force }: Load): number[] {
  return posture.joint_axes.map((axis, j) => {
    const lever = subtract(point, posture.joint_origins[j] ?? [0, 0, 0]);
    return (compliances[j] ?? 0) * dot(axis, slides(posture, j) ? force : cross(lever, force));
  });
}

const slides = (posture: Posture, j: number): boolean => posture.joint_kinds[j] === "prismatic";

/** A point that the joints before `count` carry, after they have moved by [rad, m]: it turns about their axes, or slides. */
export function carried(posture: Posture, angles: readonly number[], point: Vector, count: number): Vector {
  let moved = point;
  for (let j = count - 1; j >= 0; j--) {
    const origin = posture.joint_origins[j] ?? [0, 0, 0];
    const axis = posture.joint_axes[j] ?? [0, 0, 1];
    moved = slides(posture, j)
      ? add(moved, times(axis, angles[j] ?? 0))
      : add(origin, rotated(subtract(moved, origin), axis, angles[j] ?? 0));
  }
  return moved;
}

/** The posture after its joints have moved further [rad, m]. */
export function bent(posture: Posture, angles: number[]): Posture {
  const moved = (point: Vector, count: number) =>
    [...carried(posture, angles, point, count)] as [number, number, number];
  const tip = (j: number) => add(posture.joint_origins[j] ?? [0, 0, 0], posture.joint_axes[j] ?? [0, 0, 1]);
  const origins = posture.joint_origins.map((origin, j) => moved(origin, j));
  return {
    ...posture,
    joint_origins: origins,
    joint_axes: origins.map((origin, j) => [...subtract(moved(tip(j), j), origin)] as [number, number, number]),
    flange_origin: moved(posture.flange_origin, posture.joint_origins.length),
  };
}

/** Rodrigues' formula; the axis has length 1. */
function rotated(v: Vector, axis: Vector, angle: number): Vector {
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  return add(add(times(v, c), times(cross(axis, v), s)), times(axis, dot(axis, v) * (1 - c)));
}
