/** Places of a map and points of a corrected program as their tables have them, and what of them is drawn. */
import type { MapRequest } from "../api/types";
import { extent, roundStep } from "./format";
import { type Columns, numeric, readerOf } from "./json";
import { radians } from "./stiffness";
import { norm, subtract, type Vector } from "./vector";

/** Why a place has no numbers, or that it has. */
type PlaceStatus = "reached" | "out_of_reach" | "joint_limits" | "unseen_joint" | "overloaded" | "not_followed";

export interface MapPlace {
  status: PlaceStatus;
  /** In R0 [m]. */
  position: Vector;
  /** Joints as the controller shows them [rad, m]; empty where no posture is within limits. */
  joints: number[];
  /** [m]; NaN where there is no number, as in all that follows. */
  displacement: Vector;
  deflection: number;
  readingsOnly: readonly [number, number];
  withModelError: readonly [number, number];
  along: number;
  across: number;
  extrapolation: number;
}

export type Quantity = "deflection" | "upper" | "along" | "across";

/** The places of a map's table; joints are its columns in radians, prismatic ones `joint …` in metres. */
export function placesOf(table: Columns): MapPlace[] {
  const { column, numbers } = readerOf(table);
  const angles = table.columns.filter(
    ({ name, unit }) => unit === "rad" || (unit === "m" && name.startsWith("joint ")),
  );
  return column("status").map((status, i) => {
    const at = (head: string): number => numbers(head, i);
    const posture = angles.map(({ values }) => numeric(values[i]));
    return {
      status: status as PlaceStatus,
      position: [at("x [m]"), at("y [m]"), at("z [m]")],
      joints: posture.some(Number.isNaN) ? [] : posture,
      displacement: [at("dx [m]"), at("dy [m]"), at("dz [m]")],
      deflection: at("deflection [m]"),
      readingsOnly: [at("readings only low [m]"), at("readings only high [m]")],
      withModelError: [at("with model error low [m]"), at("with model error high [m]")],
      along: at("compliance along [m/N]"),
      across: at("compliance across [m/N]"),
      extrapolation: at("extrapolation [1]"),
    };
  });
}

/** A quantity in µm or µm/N. */
export const valueOfPlace = (place: MapPlace, quantity: Quantity): number =>
  1e6 * (quantity === "upper" ? place.withModelError[1] : place[quantity]);

export type Axis = 0 | 1 | 2;

/** Places of a slice across an axis, in rows from the top: v falls down the rows, u grows along them. */
export interface Slice {
  u: Axis;
  v: Axis;
  /** Index of each cell's place, row by row. */
  cells: number[][];
}

/** Most cells of a slice along an axis; of finer grids every second or third place is drawn. */
const MOST = 60;

/** `area`: the box of the map; the longer side of the slice lies across the screen. */
export function sliceOf(grid: MapRequest["grid"], across: Axis, layer: number, area?: MapRequest["area"]): Slice {
  const span = (axis: Axis) => (area ? area[1][axis] - area[0][axis] : 0);
  const axes = ([0, 1, 2] as const).filter((axis) => axis !== across) as [Axis, Axis];
  const [u, v] = span(axes[1]) > span(axes[0]) ? [axes[1], axes[0]] : axes;
  const index = (i: number, j: number): number => {
    const at = [0, 0, 0];
    [at[across], at[u], at[v]] = [layer, i, j];
    return ((at[0] ?? 0) * grid[1] + (at[1] ?? 0)) * grid[2] + (at[2] ?? 0);
  };
  const steps = (count: number): number[] => {
    const every = Math.ceil(count / MOST);
    return Array.from({ length: Math.ceil(count / every) }, (_, i) => i * every);
  };
  const cells = steps(grid[v])
    .reverse()
    .map((j) => steps(grid[u]).map((i) => index(i, j)));
  return { u, v, cells };
}

/** The axis with fewest places: slices across it show most. */
export const thinnest = (grid: MapRequest["grid"]): Axis => grid.lastIndexOf(Math.min(...grid)) as Axis;

/** The place with the greatest value, or null. */
export function greatest(values: number[]): number | null {
  let best: number | null = null;
  values.forEach((value, i) => {
    if (Number.isFinite(value) && (best === null || value > (values[best] ?? 0))) best = i;
  });
  return best;
}

/** A box around points, widened, in whole centimetres. */
export function boxAround(points: Vector[], margin = 0.05): [Vector, Vector] {
  const corner = (of: (...values: number[]) => number, by: number) =>
    ([0, 1, 2] as const).map((axis) => Math.round((of(...points.map((p) => p[axis])) + by) * 100) / 100);
  return [corner(Math.min, -margin), corner(Math.max, margin)] as unknown as [Vector, Vector];
}

export interface PathPoint {
  number: number;
  line: number;
  place: Vector;
  /** Controller's angles where the loaded tool is wanted [rad]. */
  joints: number[];
  /** How far the load moves the tool [mm]; NaN without a load. */
  deflection: number;
  /** Interval of the deflection, with the model error if that is bounded [mm]; NaN where there is none. */
  interval: readonly [number, number];
  /** Distance of the loaded tool from its target, as the program is written [mm]. */
  residual: number;
  /** Interval of that distance, as `interval` [mm]. */
  residualInterval: readonly [number, number];
  /** Whether both intervals include the model error. */
  withModelError: boolean;
  /** Length of the path up to here, in straight lines [m]. */
  along: number;
}

/** The points of a program's table, in the order of the path. */
export function pointsOf(table: Columns): PathPoint[] {
  const { column, numbers } = readerOf(table);
  let along = 0;
  let before: Vector | null = null;
  return column("point").map((number, i) => {
    const at = (head: string): number => numbers(head, i);
    const place: Vector = [at("place x [m]"), at("place y [m]"), at("place z [m]")];
    along += before ? norm(subtract(place, before)) : 0;
    before = place;
    const withModelError = Number.isFinite(at("deflection high, with model error [mm]"));
    const by = withModelError ? "with model error" : "readings";
    const ends = (of: string) => [at(`${of} low, ${by} [mm]`), at(`${of} high, ${by} [mm]`)] as const;
    return {
      number: numeric(number),
      line: at("line"),
      place,
      along,
      interval: ends("deflection"),
      residualInterval: ends("residual"),
      withModelError,
      joints: [1, 2, 3, 4, 5, 6].map((j) => radians(at(`J${j} [deg]`))),
      deflection: at("deflection [mm]"),
      residual: at("residual [mm]"),
    };
  });
}

/** Bins of a round width from zero that hold all values, about so many, and the number of values of each series in each. */
export function binned(series: number[][], about: number): { width: number; counts: number[][] } {
  const most = extent(series.flat())?.[1] || 1;
  const width = roundStep(most, about);
  const count = Math.max(1, Math.ceil(most / width));
  const counts = series.map((values) => {
    const found = Array<number>(count).fill(0);
    for (const value of values) {
      const bin = Math.min(count - 1, Math.floor(value / width));
      if (bin >= 0) found[bin] = (found[bin] ?? 0) + 1;
    }
    return found;
  });
  return { width, counts };
}

/** At most `most` of a path's points, evenly, its ends among them. */
export function thinned<Point>(points: Point[], most: number): Point[] {
  if (points.length <= most) return points;
  const step = (points.length - 1) / (most - 1);
  return Array.from({ length: most }, (_, i) => points[Math.round(i * step)] as Point);
}
