/** What a dropped file is, and what was understood of it, before the service checks it. */
import type { MeasurementSet, RobotDocument, RunOptions, Units } from "../api/types";
import { type Fields, isFields, parsed } from "./json";
import { factors } from "./units";
import { norm, times, type Vector } from "./vector";

const ENCODERS: MeasurementSet["encoders"][] = ["motor", "secondary"];

/** A file that can be sent. `set` goes to the service as it stands. */
export interface Campaign {
  robot: RobotDocument | null;
  robotId: string | null;
  set: Fields;
  run: Partial<RunOptions> | null;
  facts: Facts;
}

/** What the file says, for people; null for what it does not say. */
export interface Facts {
  name: string | null;
  units: Units | null;
  encoders: MeasurementSet["encoders"] | null;
  observations: number;
  joints: number | null;
  targets: string[];
  readings: number;
  forces: [number, number] | null;
  sigma: number | null;
  /** Where the noise comes from if not from one sigma: the tracker's sheet, or each reading. */
  noise: "instrument" | "readings" | null;
  /** Whether positions are in a tracker's frame. */
  framed: boolean;
  loadPoint: Vector | null;
  firstJoints: number[] | null;
}

export type Fault = "not_json" | "not_finite" | "empty" | "not_object" | "not_a_set" | "sweeps";

/** Read a file's text. Only its outline is looked at here: the service says what is wrong inside. */
export function understand(content: string): Campaign | Fault {
  if (content.trim() === "") return "empty";
  const document = parsed(content);
  if (document === undefined) return notFinite(content) === null ? "not_json" : "not_finite";
  if (!isFields(document)) return "not_object";
  if (Array.isArray(document["sweeps"]) || Array.isArray(document["poses"])) return "sweeps";
  const inside = document["measurement_set"];
  if (isFields(inside)) return campaign(inside, document["robot"], document["run"]);
  return Array.isArray(document["observations"]) ? campaign(document, null, null) : "not_a_set";
}

/** Where NaN or Infinity stands in a text that is JSON but for it, as `NaN in measurement_set.noise.sigma`; else null. */
export function notFinite(content: string): string | null {
  const marked = content
    .replace(/^\ufeff/, "")
    .replace(/"(?:[^"\\]|\\.)*"|-?\b(?:NaN|Infinity)\b/g, (token) =>
      token.startsWith('"') ? token : `"${MARK}${token}"`,
    );
  const found = (value: unknown, path: string): string | null => {
    if (typeof value === "string") return value.startsWith(MARK) ? `${value.slice(MARK.length)} in ${path}` : null;
    if (typeof value !== "object" || value === null) return null;
    for (const [key, part] of Object.entries(value)) {
      const place = found(part, Array.isArray(value) ? `${path}[${key}]` : `${path}${path && "."}${key}`);
      if (place !== null) return place;
    }
    return null;
  };
  try {
    return found(JSON.parse(marked), "");
  } catch {
    return null;
  }
}

/** Before a number that JSON does not have. */
const MARK = "not finite: ";

function campaign(given: Fields, robot: unknown, run: unknown): Campaign {
  const { robot_id: robotId, ...set } = given;
  return {
    robot: isFields(robot) ? (robot as unknown as RobotDocument) : null,
    robotId: typeof robotId === "string" ? robotId : null,
    set,
    run: isFields(run) ? (run as Partial<RunOptions>) : null,
    facts: factsOf(set),
  };
}

export function factsOf(set: Fields): Facts {
  const observations = (Array.isArray(set["observations"]) ? set["observations"] : []).filter(isFields);
  const units = unitsOf(set["units"]);
  const readings = observations.flatMap((o) => (Array.isArray(o["readings"]) ? o["readings"].filter(isFields) : []));
  const joints = observations.map((o) => numbers(o["joints"])).find((angles) => angles !== null) ?? null;
  const given = isFields(set["noise"]) ? set["noise"] : {};
  const noise = given["sigma"];
  const point = vector(set["load_point"]);
  const unit = units && factors(units);
  return {
    name: typeof set["name"] === "string" ? set["name"] : null,
    units,
    encoders: ENCODERS.find((kind) => kind === set["encoders"]) ?? null,
    observations: observations.length,
    joints: joints?.length ?? null,
    targets: [...new Set(readings.map((r) => r["target"]).filter((t): t is string => typeof t === "string"))],
    readings: readings.length,
    forces:
      unit &&
      range(
        observations.map((o) => vector(o["force"])),
        unit.force,
      ),
    sigma: unit && typeof noise === "number" ? noise * unit.length : null,
    noise: isFields(given["instrument"]) ? "instrument" : readings.some(statesNoise) ? "readings" : null,
    framed: isFields(set["frame"]),
    loadPoint: unit && point && times(point, unit.length),
    firstJoints: unit && joints && joints.map((angle) => angle * unit.angle),
  };
}

const statesNoise = (reading: Fields): boolean =>
  Object.keys(reading).some((key) => /sigma|covariance/.test(key) && reading[key] !== null);

function unitsOf(value: unknown): Units | null {
  if (!isFields(value)) return null;
  const known =
    ["m", "mm"].includes(String(value["length"])) &&
    ["rad", "deg"].includes(String(value["angle"])) &&
    ["N", "kN", "kgf", "kg"].includes(String(value["force"]));
  return known ? (value as unknown as Units) : null;
}

function range(forces: (Vector | null)[], factor: number): [number, number] | null {
  const strengths = forces.filter((f) => f !== null).map((f) => norm(f) * factor);
  if (strengths.length === 0) return null;
  return strengths.reduce<[number, number]>(([low, high], s) => [Math.min(low, s), Math.max(high, s)], [Infinity, 0]);
}

function vector(value: unknown): Vector | null {
  const list = numbers(value);
  return list?.length === 3 ? (list as unknown as Vector) : null;
}

function numbers(value: unknown): number[] | null {
  return Array.isArray(value) && value.length > 0 && value.every((v) => typeof v === "number") ? value : null;
}
