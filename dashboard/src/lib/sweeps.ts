/** Sweeps or poses in a dropped file: what was understood, before the service checks them. */
import type { RobotDocument } from "../api/types";
import { type Fields, isFields, parsed } from "./json";
import { degrees } from "./units";

/** A file of readings for a geometry. `request` goes to the service with the nominal model that is chosen. */
export interface Readings {
  request: Fields;
  robot: RobotDocument | null;
  robotId: string | null;
  facts: ReadingFacts;
}

export interface ReadingFacts {
  name: string | null;
  units: string | null;
  /** Each joint's positions and arc [°]; none for poses. */
  sweeps: { joint: string; positions: number; arc: number | null }[];
  poses: number | null;
  targets: string[];
}

/** Read a file's text; null if there are no sweeps and no poses in it. */
export function readingsOf(content: string): Readings | null {
  const document = parsed(content);
  if (!isFields(document)) return null;
  const { robot, robot_id: robotId, ...request } = document;
  const { sweeps, poses } = request;
  if (!Array.isArray(sweeps) && !Array.isArray(poses)) return null;
  return {
    request,
    robot: isFields(robot) ? (robot as unknown as RobotDocument) : null,
    robotId: typeof robotId === "string" ? robotId : null,
    facts: factsOf(request),
  };
}

function factsOf(request: Fields): ReadingFacts {
  const units = isFields(request["units"]) ? request["units"] : {};
  const sweeps = list(request["sweeps"]).map((sweep) => ({
    joint: String(sweep["joint"] ?? ""),
    positions: list(sweep["observations"]).length,
    arc: arcOf(list(sweep["observations"]), units["angle"]),
  }));
  const positions = [...list(request["sweeps"]).flatMap((s) => list(s["observations"])), ...list(request["poses"])];
  const targets = positions.flatMap((p) => (isFields(p["targets"]) ? Object.keys(p["targets"]) : []));
  const { length, angle } = units;
  return {
    name: typeof request["name"] === "string" ? request["name"] : null,
    units: typeof length === "string" && typeof angle === "string" ? `${length}, ${angle}` : null,
    sweeps,
    poses: Array.isArray(request["poses"]) ? request["poses"].length : null,
    targets: [...new Set(targets)],
  };
}

/** The widest range of one joint's angles [°]. */
function arcOf(positions: Fields[], unit: unknown): number | null {
  const rows = positions.map((p) => p["joints"]).filter((row): row is number[] => Array.isArray(row));
  const joints = rows[0]?.length ?? 0;
  const ranges = Array.from({ length: joints }, (_, j) => {
    const angles = rows.map((row) => Number(row[j]));
    return Math.max(...angles) - Math.min(...angles);
  });
  const widest = Math.max(0, ...ranges);
  if (!Number.isFinite(widest) || joints === 0) return null;
  return unit === "rad" ? degrees(widest) : unit === "deg" ? widest : null;
}

const list = (value: unknown): Fields[] => (Array.isArray(value) ? value.filter(isFields) : []);
