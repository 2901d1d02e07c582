/** The wall of robots: an arm a row, with the joints that changed since its first campaign. */
import type { Estimate, RobotSummary } from "../../api/types";
import { robotsToldApart } from "../../state/choices";

export interface WallCell {
  joint: string;
  /** Null: no change is known, of a joint that was tested or not. */
  change: Estimate | null;
}

/** One arm: a robot, or another serial number of it that changed. */
export interface WallRow {
  robot: string;
  name: string;
  /** What tells it from robots of its name; its serial number. */
  note: string;
  serial: string | null;
  /** Time of the last campaign. */
  at: string;
  cells: WallCell[];
}

/** How many standard uncertainties a change is; infinite where its uncertainty is unknown. */
export const significanceOf = ({ value, standard_uncertainty: u }: Estimate): number =>
  u ? Math.abs(value) / u : Number.POSITIVE_INFINITY;

/** The most significant change of a row; softer joints are worse than stiffer ones. */
function badness({ cells }: WallRow): number {
  const changes = cells.flatMap(({ change }) => (change ? [change] : []));
  const softer = changes.filter(({ value }) => value < 0).map(significanceOf);
  if (softer.length > 0) return 1e6 + Math.min(1e6, Math.max(...softer));
  return Math.max(0, ...changes.map((change) => Math.min(1e5, significanceOf(change))));
}

function rowsOf(robot: RobotSummary, apart: string): WallRow[] {
  const { last_campaign: last } = robot;
  if (!last) return [];
  const others = last.changed.map(({ serial_number: serial }) => serial);
  const serials = new Set([last.serial_number, ...others]);
  return [...serials].map((serial) => {
    const changed = last.changed.filter(({ serial_number: own }) => own === serial);
    const cells = robot.joints.map(({ name: joint }) => ({
      joint,
      change: changed.find((one) => one.joint === joint)?.change ?? null,
    }));
    const note = [...new Set([serial, apart].filter(Boolean))].join(", ");
    return { robot: robot.id, name: robot.name, note, serial, at: last.at, cells };
  });
}

/** Between a name and what tells it apart. */
const SEPARATOR = " · ";

/** All arms that were measured, worst first, then those that were measured last. */
export function wallOf(robots: RobotSummary[]): WallRow[] {
  const names = robotsToldApart(robots);
  const apart = ({ id, name }: RobotSummary) => (names.get(id) ?? "").slice(name.length + SEPARATOR.length);
  const rows = robots.flatMap((robot) => rowsOf(robot, apart(robot)));
  return rows.sort((a, b) => badness(b) - badness(a) || b.at.localeCompare(a.at));
}
