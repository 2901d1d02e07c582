/** Three numbers and what is done with them. */

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
