/** Points of a compensated program, as points.csv has them. */
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

/** Read the table. Names with commas stand in quotes. */
export function parsePoints(csv: string): PathPoint[] {
  const [head = "", ...rows] = csv.split("\n");
  const columns = cells(head);
  const at = (row: string[], name: string): number => {
    const cell = row[columns.indexOf(name)];
    return cell === undefined || cell === "" ? Number.NaN : Number(cell);
  };
  return rows.filter(Boolean).map((text) => {
    const row = cells(text);
    return {
      number: at(row, "point"),
      name: row[1] ?? "",
      line: at(row, "line"),
      place: [at(row, "place x [m]"), at(row, "place y [m]"), at(row, "place z [m]")],
      joints: [1, 2, 3, 4, 5, 6].map((j) => at(row, `J${j} [deg]`) * DEGREE),
      deflection: at(row, "deflection [mm]"),
      residual: at(row, "residual [mm]"),
    };
  });
}

function cells(row: string): string[] {
  // With a comma before each cell no match is empty, so that an empty first cell is one.
  return [...`,${row}`.matchAll(/,(?:"((?:[^"]|"")*)"|([^,]*))/g)].map(
    ([, quoted, plain]) => quoted?.replaceAll('""', '"') ?? plain ?? "",
  );
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
