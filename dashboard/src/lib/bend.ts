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

/** The posture after its joints have moved further [rad, m]: what a joint carries turns about its axis, or slides. */
export function bent(posture: Posture, angles: number[]): Posture {
  const about = (point: Vector, joints: number): Vector => {
    let moved = point;
    for (let j = joints - 1; j >= 0; j--) {
      const origin = posture.joint_origins[j] ?? [0, 0, 0];
      const axis = posture.joint_axes[j] ?? [0, 0, 1];
      moved = slides(posture, j)
        ? add(moved, times(axis, angles[j] ?? 0))
        : add(origin, rotated(subtract(moved, origin), axis, angles[j] ?? 0));
    }
    return moved;
  };
  const along = (direction: Vector, joints: number): Vector => {
    let turned = direction;
    for (let j = joints - 1; j >= 0; j--)
      if (!slides(posture, j)) turned = rotated(turned, posture.joint_axes[j] ?? [0, 0, 1], angles[j] ?? 0);
    return turned;
  };
  const all = posture.joint_origins.length;
  return {
    ...posture,
    joint_origins: posture.joint_origins.map((origin, j) => [...about(origin, j)] as [number, number, number]),
    joint_axes: posture.joint_axes.map((axis, j) => [...along(axis, j)] as [number, number, number]),
    flange_origin: [...about(posture.flange_origin, all)] as [number, number, number],
  };
}

/** Rodrigues' formula; the axis has length 1. */
function rotated(v: Vector, axis: Vector, angle: number): Vector {
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  return add(add(times(v, c), times(cross(axis, v), s)), times(axis, dot(axis, v) * (1 - c)));
}
