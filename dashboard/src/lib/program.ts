/** Points of a compensated program, as its table has them. */
import { type Columns, numeric, readerOf } from "./json";
import type { Vector } from "./vector";

export interface PathPoint {
  number: number;
  name: string;
  line: number;
  place: Vector;
  /** Controller's angles where the loaded tool is wanted [rad]. */
  joints: number[];
  /** How far the load moves the tool [mm]; NaN without a load. */
  deflection: number;
  /** Distance of the loaded tool from its target, as the program is written [mm]. */
  residual: number;
}

const DEGREE = Math.PI / 180;

/** The points of a program's table, in the order of the path. */
export function pointsOf(table: Columns): PathPoint[] {
  const { column, numbers } = readerOf(table);
  const names = column("name");
  return column("point").map((number, i) => {
    const at = (head: string): number => numbers(head, i);
    return {
      number: numeric(number),
      name: String(names[i] ?? ""),
      line: at("line"),
      place: [at("place x [m]"), at("place y [m]"), at("place z [m]")],
      joints: [1, 2, 3, 4, 5, 6].map((j) => at(`J${j} [deg]`) * DEGREE),
      deflection: at("deflection [mm]"),
      residual: at("residual [mm]"),
    };
  });
}

/** At most `most` of a path's points, evenly, its ends among them. */
export function thinned<Point>(points: Point[], most: number): Point[] {
  if (points.length <= most) return points;
  const step = (points.length - 1) / (most - 1);
  return Array.from({ length: most }, (_, i) => points[Math.round(i * step)] as Point);
}

/** Numbers that stand in a text, parted by blanks, commas or semicolons; null if any is none. */
export function numbersIn(text: string): number[] | null {
  const found = text.split(/[\s,;]+/).filter(Boolean);
  const values = found.map(Number);
  return values.every(Number.isFinite) ? values : null;
}
