/** The wall of robots: an arm a row, with the joints that changed since its first campaign. */
import type { Estimate, RobotSummary } from "../../api/types";
import { dayText } from "../../lib/format";
import { text } from "../../words";

export interface WallCell {
  joint: string;
  /** Null: no change beyond chance, of a joint that was tested. */
  change: Estimate | null;
  /** Whether two campaigns of the arm could be compared. */
  tested: boolean;
}

/** One arm: a robot, or one of the serial numbers of its sets. */
export interface WallRow {
  robot: string;
  name: string;
  /** Its serial number, and what tells it from arms of its name and number. */
  note: string;
  serial: string | null;
  /** Time of its last campaign. */
  at: string;
  /** The worst arm has the greatest. */
  rank: number;
  cells: WallCell[];
}

/** How many standard uncertainties a change is; infinite where its uncertainty is unknown. */
export const significanceOf = ({ value, standard_uncertainty: u }: Estimate): number =>
  u ? Math.abs(value) / u : Number.POSITIVE_INFINITY;

function rowsOf(robot: RobotSummary): WallRow[] {
  return robot.arms.map(({ serial_number: serial, at, tested, rank }) => {
    const changed = robot.last_campaign?.changed.filter(({ serial_number: own }) => own === serial) ?? [];
    const cells = robot.joints.map(({ name: joint }) => ({
      joint,
      change: changed.find((one) => one.joint === joint)?.change ?? null,
      tested: tested.includes(joint),
    }));
    return { robot: robot.id, name: robot.name, note: serial ?? "", serial, at, rank, cells };
  });
}

/** Characters of an id, as many as a person compares. */
const SHORT_ID = 6;

/** Add a hint to the notes of rows that have one name and one note. */
function tellApart(rows: WallRow[], hint: (robot: string) => string): WallRow[] {
  const keyOf = ({ name, note }: WallRow) => `${name}\n${note}`;
  const count = new Map<string, number>();
  for (const key of rows.map(keyOf)) count.set(key, (count.get(key) ?? 0) + 1);
  const isAlone = (row: WallRow) => count.get(keyOf(row)) === 1;
  return rows.map((row) =>
    isAlone(row) ? row : { ...row, note: [row.note, hint(row.robot)].filter(Boolean).join(", ") },
  );
}

/** All arms that were measured, worst first, then those that were measured last. */
export function wallOf(robots: RobotSummary[]): WallRow[] {
  const added = new Map(robots.map(({ id, created_at: at }) => [id, text.lists.addedOn(dayText(at))]));
  const byDay = tellApart(robots.flatMap(rowsOf), (robot) => added.get(robot) ?? "");
  const rows = tellApart(byDay, (robot) => robot.slice(0, SHORT_ID));
  return rows.sort((a, b) => b.rank - a.rank || b.at.localeCompare(a.at));
}
