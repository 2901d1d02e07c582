/** The arm bent by its load, joint by joint. */
import type { Posture } from "../api/types";
import type { Load } from "./places";
import { add, cross, dot, subtract, times, type Vector } from "./vector";

/** Angles [rad] by which the joints give way: compliance c_j times the torque a_j · ((p − o_j) × F) of the load. */
export function bendOf(posture: Posture, compliances: (number | null)[], { point, force }: Load): number[] {
  return posture.joint_axes.map((axis, j) => {
    const lever = subtract(point, posture.joint_origins[j] ?? [0, 0, 0]);
    return (compliances[j] ?? 0) * dot(axis, cross(lever, force));
  });
}

/** The posture after its joints have turned by some more angles [rad]: what a joint carries turns about its axis. */
export function bent(posture: Posture, angles: number[]): Posture {
  const about = (point: Vector, joints: number): Vector => {
    let moved = point;
    for (let j = joints - 1; j >= 0; j--) {
      const origin = posture.joint_origins[j] ?? [0, 0, 0];
      moved = add(origin, rotated(subtract(moved, origin), posture.joint_axes[j] ?? [0, 0, 1], angles[j] ?? 0));
    }
    return moved;
  };
  const along = (direction: Vector, joints: number): Vector => {
    let turned = direction;
    for (let j = joints - 1; j >= 0; j--) turned = rotated(turned, posture.joint_axes[j] ?? [0, 0, 1], angles[j] ?? 0);
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
