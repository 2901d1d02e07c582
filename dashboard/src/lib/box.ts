/** A box whose sides lie along the axes of R0, and how it follows what is dragged. Lengths in m, R0. */
import { numeric } from "./json";
import type { Axis } from "./map";
import { dot, subtract, times, type Vector } from "./vector";

/** Least and greatest corner. */
export type Box = readonly [Vector, Vector];

/** What of a box is dragged: a face, by its axis and the corner that it belongs to, or the middle. */
export type Grip = { axis: Axis; corner: 0 | 1 } | "middle";

const AXES = [0, 1, 2] as const;
export const GRIPS: readonly Grip[] = [
  ...AXES.flatMap((axis) => [{ axis, corner: 0 } as const, { axis, corner: 1 } as const]),
  "middle",
];

/** What is dragged stops at multiples of this length. */
const STEP = 0.01;
const stopped = (value: number): number => Number((Math.round(value / STEP) * STEP).toFixed(4));
const exact = (value: number): number => Number(value.toFixed(6));

/** A line of sight steeper than this to an axis or a plane cannot say how far along it something was dragged. */
const STEEP = 0.05;

/** The box of two corners as a form has them, their numbers in a unit of `size`; null of anything else. */
export function boxIn(value: unknown, size: number): Box | null {
  const corners = Array.isArray(value) ? (value as unknown[]) : [];
  const [first, second] = corners.map((corner) => (Array.isArray(corner) ? corner.map(numeric) : []));
  if (corners.length !== 2 || first?.length !== 3 || second?.length !== 3) return null;
  if (![...first, ...second].every(Number.isFinite)) return null;
  const corner = (of: (a: number, b: number) => number) =>
    AXES.map((axis) => exact(size * of(first[axis] ?? 0, second[axis] ?? 0))) as unknown as Vector;
  return [corner(Math.min), corner(Math.max)];
}

/** A box about a point, its numbers in steps. */
export const boxAbout = (point: Vector, half: Vector): Box =>
  [-1, 1].map((side) => AXES.map((axis) => stopped(point[axis] + side * half[axis]))) as unknown as Box;

/** Where a grip of a box is. */
export const placeOf = ([low, high]: Box, grip: Grip): Vector =>
  AXES.map((axis) =>
    grip !== "middle" && grip.axis === axis ? [low, high][grip.corner]?.[axis] : (low[axis] + high[axis]) / 2,
  ) as unknown as Vector;

/**
 * The box after a grip was dragged by `move`, which lies in the plane of the picture; `look` is the unit vector from
 * the eye into the picture. A face moves along its axis, no further than the face opposite. The middle moves the box
 * at its height; seen from nearly that height it moves as it is dragged.
 */
export function dragged(box: Box, grip: Grip, move: Vector, look: Vector): Box {
  if (grip === "middle") {
    const level = Math.abs(look[2]) > 0.3;
    const by = level ? subtract(move, times(look, move[2] / look[2])) : move;
    const shift = AXES.map((axis) => (level && axis === 2 ? 0 : stopped(box[0][axis] + by[axis]) - box[0][axis]));
    return box.map((corner) => AXES.map((axis) => exact(corner[axis] + (shift[axis] ?? 0)))) as unknown as Box;
  }
  const { axis, corner } = grip;
  const unit = AXES.map((each) => (each === axis ? 1 : 0)) as unknown as Vector;
  const seen = subtract(unit, times(look, dot(unit, look)));
  const length = dot(seen, seen);
  if (length < STEEP) return box;
  const to = stopped(box[corner][axis] + dot(move, seen) / length);
  const other = box[1 - corner]?.[axis] ?? to;
  const stop = corner === 0 ? Math.min(to, other) : Math.max(to, other);
  return box.map((each, i) =>
    i === corner ? each.map((old, j) => (j === axis ? stop : old)) : each,
  ) as unknown as Box;
}
