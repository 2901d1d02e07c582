/** Points and places of a process as its tables have them: deflections along the path, and the best turn at each place. */
import type { MapPlace, PathPoint } from "../../lib/map";
import { pointsOf } from "../../lib/map";
import { type Columns, readerOf } from "../../lib/json";
import { norm, subtract } from "../../lib/vector";

/** A state of the path. */
export type Stage = "before" | "turned" | "left";

/** A point of the path as chosen; lengths of deflections in mm, NaN where there is none. */
export interface ProcessPoint extends PathPoint {
  /** Length of the path up to here [mm]. */
  along: number;
  /** Turn about the spindle [°]; NaN where the joints were given. */
  turn: number;
  before: number;
  turned: number;
  left: number;
  /** Interval of each deflection, with the model error where that is known. */
  intervals: Record<Stage, readonly [number, number]>;
  /** Whether the intervals include the model error. */
  withModelError: boolean;
}

/** The points of a path, from the table of its points and that of its turns, which have the same rows. */
export function processPointsOf(points: Columns, turns: Columns): ProcessPoint[] {
  const { numbers } = readerOf(turns);
  let along = 0;
  return pointsOf(points).map((point, i, all) => {
    const before = all[i - 1];
    if (before) along += 1e3 * norm(subtract(point.place, before.place));
    const at = (head: string): number => numbers(head, i);
    const interval = (of: string): readonly [number, number] => {
      const ends = (by: string) => [at(`${of} low, ${by} [mm]`), at(`${of} high, ${by} [mm]`)] as const;
      const widest = ends("with model error");
      return Number.isNaN(widest[1]) ? ends("readings") : widest;
    };
    return {
      ...point,
      along,
      turn: at("turn [deg]"),
      before: at("before [mm]"),
      turned: at("turned [mm]"),
      left: at("remaining [mm]"),
      withModelError: Number.isFinite(at("turned high, with model error [mm]")),
      intervals: { before: interval("before"), turned: interval("turned"), left: interval("remaining") },
    };
  });
}

/** A place of the grid with its best turn of the workpiece. */
export interface SearchedPlace extends MapPlace {
  /** Turn about z with the least deflection [°]; NaN where none lets the robot follow the path. */
  turn: number;
}

/** The places of the grid, from the table of all places and turns that were tried, turn by turn. */
export function searchedPlacesOf(table: Columns): SearchedPlace[] {
  const { column, numbers } = readerOf(table);
  const best = new Map<string, SearchedPlace>();
  column("x [m]").forEach((_, i) => {
    const at = (head: string): number => numbers(head, i);
    if (at("of grid") === 0) return;
    const position = [at("x [m]"), at("y [m]"), at("z [m]")] as const;
    const [deflection, key] = [at("deflection [m]"), position.join()];
    const before = best.get(key);
    if (before && !(deflection < before.deflection) && !(Number.isNaN(before.deflection) && deflection >= 0)) return;
    const reached = Number.isFinite(deflection);
    best.set(key, {
      ...UNKNOWN,
      status: reached ? "reached" : "out_of_reach",
      position,
      deflection,
      turn: reached ? at("turn [deg]") : Number.NaN,
    });
  });
  return [...best.values()];
}

const NONE = [Number.NaN, Number.NaN] as const;
/** What the search of places does not state. */
const UNKNOWN = {
  joints: [],
  displacement: [Number.NaN, ...NONE] as const,
  readingsOnly: NONE,
  withModelError: NONE,
  along: Number.NaN,
  across: Number.NaN,
  extrapolation: Number.NaN,
};
