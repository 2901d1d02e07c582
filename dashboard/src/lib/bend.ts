/** The arm bent by its load, joint by joint. */
import type { Posture } from "../api/types";
import type { Load } from "./places";
import { add, cross, dot, subtract, times, type Vector } from "./vector";

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
