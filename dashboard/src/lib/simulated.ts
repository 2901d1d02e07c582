/** An arm of springs that the page simulates, to try a live campaign without one. Units: m, rad, N. */
import type { Posture } from "../api/types";
import { carried } from "./bend";
import type { Rows } from "./live";
import { add, cross, dot, fromFlange, subtract, type Vector } from "./vector";

/** What a set says that was opened as a simulated one. */
export const SIMULATED = "simulated by the page";
export const SIMULATED_ARM = "KUKA KR 210 R2700 extra";
export const SIMULATED_MASS = 150;
export const SIMULATED_LOAD_POINT: Vector = [-0.06, 0.02, 0.18];
export const SIMULATED_TARGETS: Record<string, Vector> = {
  P1: [0.147, 0.055, 0.05],
  P2: [-0.137, 0.087, 0.085],
  P3: [-0.007, -0.14, 0.12],
};
export const SIGMA = 2e-5;
const USUAL = [3.8e6, 3.1e6, 2.5e6, 0.45e6, 0.25e6, 0.09e6];
const BALANCES = 30;

/** Numbers between 0 and 1 that a text decides: the same on every device. */
export function numbersOf(seed: string): () => number {
  let state = [...seed].reduce((hash, letter) => Math.imul(hash ^ letter.charCodeAt(0), 16777619), 2166136261);
  return () => {
    state = (state + 0x6d2b79f5) | 0;
    let mixed = Math.imul(state ^ (state >>> 15), 1 | state);
    mixed = (mixed + Math.imul(mixed ^ (mixed >>> 7), 61 | mixed)) ^ mixed;
    return ((mixed ^ (mixed >>> 14)) >>> 0) / 4294967296;
  };
}

/** Stiffnesses of the simulated arm [N·m/rad]: usual ones, each up to 30 % off. */
export function stiffnessesOf(seed: number): number[] {
  const draw = numbersOf(`arm ${seed}`);
  return USUAL.map((usual) => Number((usual * (0.7 + 0.6 * draw())).toPrecision(3)));
}

export const seedOf = (notes: string | null | undefined): number => Number(/seed (\d+)/.exec(notes ?? "")?.[1] ?? 0);

/**
 * Angles [rad] by which revolute joints give way until the springs balance a force [N] at a point of the flange:
 * angle = torque / stiffness, torque about the axes where they then are.
 */
export function givenWay(posture: Posture, stiffnesses: readonly number[], at: Vector, force: Vector): number[] {
  const count = posture.joint_origins.length;
  const point = onFlange(posture, at);
  let angles = Array<number>(count).fill(0);
  for (let round = 0; round < BALANCES; round++) {
    const load = carried(posture, angles, point, count);
    angles = angles.map((_, j) => {
      const origin = carried(posture, angles, posture.joint_origins[j] as unknown as Vector, j);
      const end = add(posture.joint_origins[j] as unknown as Vector, posture.joint_axes[j] as unknown as Vector);
      const axis = subtract(carried(posture, angles, end, j), origin);
      return dot(axis, cross(subtract(load, origin), force)) / (stiffnesses[j] ?? Number.POSITIVE_INFINITY);
    });
  }
  return angles;
}

const onFlange = (posture: Posture, place: Vector): Vector =>
  fromFlange(posture.flange_origin as unknown as Vector, posture.flange_axes as unknown as Vector[], place);

/** Readings of the targets before and under a load, in mm as they would be typed. */
export function simulatedRows(
  posture: Posture,
  force: Vector,
  seed: number,
  label: string,
  { targets, loadPoint }: { targets: Record<string, Vector>; loadPoint: Vector },
): Rows {
  const draw = numbersOf(`${seed} ${label}`);
  const normal = () => Math.sqrt(-2 * Math.log(1 - draw())) * Math.cos(2 * Math.PI * draw());
  const angles = givenWay(posture, stiffnessesOf(seed), loadPoint, force);
  const read = (place: Vector) => place.map((part) => (1e3 * (part + SIGMA * normal())).toFixed(4)).join(" ");
  return Object.fromEntries(
    Object.entries(targets).map(([name, place]) => {
      const before = onFlange(posture, place);
      return [name, { unloaded: read(before), loaded: read(carried(posture, angles, before, angles.length)) }];
    }),
  );
}

/** The same with the first two targets exchanged: a mistake as it happens. */
export function exchanged(rows: Rows): Rows {
  const [first, second, ...others] = Object.keys(rows);
  if (first === undefined || second === undefined) return rows;
  return Object.fromEntries([
    [first, rows[second] as Rows[string]],
    [second, rows[first] as Rows[string]],
    ...others.map((name) => [name, rows[name] as Rows[string]]),
  ]) as Rows;
}
