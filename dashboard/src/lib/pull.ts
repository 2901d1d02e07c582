/** A force that a hand pulls with: how its arrow follows the hand, and keys. Lengths in m, forces in N, R0. */
import { add, norm, subtract, times, type Vector } from "./vector";

/** A force that is pulled: where it acts, and how long a newton is drawn [m/N]. */
export interface Pull {
  from: Vector;
  force: Vector;
  scale: number;
}

/** What is pulled stops at multiples of this force [N]. */
export const STEP = 10;
/** A part of a force below this share of the whole is none: a hand means an axis. */
const AXIS = 0.08;

const stopped = (value: number): number => Math.round(value / STEP) * STEP || 0; // never −0

/** The head of the arrow. */
export const headOf = ({ from, force, scale }: Pull): Vector => add(from, times(force, scale));

/** The force whose arrow ends near a point. */
export function forceAt({ from, scale }: Pull, head: Vector): Vector {
  const force = times(subtract(head, from), 1 / scale);
  const least = AXIS * norm(force);
  return force.map((part) => (Math.abs(part) < least ? 0 : stopped(part))) as unknown as Vector;
}

/** The force after an arrow key: along the level axis nearest to the right of the picture, or up and down; null of another key. */
export function forceByKey(force: Vector, key: string, right: Vector): Vector | null {
  const alongX = Math.abs(right[0]) >= Math.abs(right[1]);
  const level: Vector = alongX ? [Math.sign(right[0]), 0, 0] : [0, Math.sign(right[1]), 0];
  const ways: Record<string, Vector> = {
    ArrowRight: level,
    ArrowLeft: times(level, -1),
    ArrowUp: [0, 0, 1],
    ArrowDown: [0, 0, -1],
  };
  const way = ways[key];
  return way ? (add(force, times(way, STEP)).map((part) => part || 0) as unknown as Vector) : null;
}
