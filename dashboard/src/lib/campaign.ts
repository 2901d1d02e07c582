/** What a dropped file is, and what was understood of it, before the service checks it; what people state and note about it. */
import {
  type MeasurementSet,
  type RobotDocument,
  type RunOptions,
  type Units,
  METADATA,
  type Metadata,
} from "../api/types";
import { type Fields, isFields, listOf, parsed, stated } from "./json";
import { extent } from "./format";
import { factors, UNITS } from "./stiffness";
import { norm, times, type Vector } from "./vector";
import { sized } from "./schema";

const ENCODERS: MeasurementSet["encoders"][] = ["motor", "secondary"];

/** A file that can be sent. `set` goes to the service as it stands. */
export interface Campaign {
  robot: RobotDocument | null;
  robotId: string | null;
  set: Fields;
  run: Partial<RunOptions> | null;
  facts: Facts;
}

/** What the file says, for people: in SI, or as stated where its unit is none; null for what it does not say. */
export interface Facts {
  name: string | null;
  units: Partial<Record<keyof Units, string>> | null;
  encoders: MeasurementSet["encoders"] | null;
  observations: number;
  targets: string[];
  forces: [number, number] | null;
  sigma: number | null;
  /** Where the noise comes from if not from one sigma: the tracker's sheet, or each reading. */
  noise: "instrument" | "readings" | null;
  /** Whether positions are in a tracker's frame. */
  framed: boolean;
  loadPoint: Vector | null;
  firstJoints: number[] | null;
}

/** Reasons why a file is no campaign. */
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
  const observations = listOf(set["observations"]);
  const units = isFields(set["units"]) ? (set["units"] as Facts["units"]) : null;
  const readings = observations.flatMap((o) => listOf(o["readings"]));
  const joints = observations.map((o) => numbers(o["joints"])).find((angles) => angles !== null) ?? null;
  const given = isFields(set["noise"]) ? set["noise"] : {};
  const noise = given["sigma"];
  const point = vector(set["load_point"]);
  const factor = (of: keyof Units) => units?.[of] && (factorOf(units, of) ?? 1); // what has no unit stays as stated
  const [length, angle, force] = [factor("length"), factorOf(units, "angle"), factor("force")];
  return {
    name: typeof set["name"] === "string" ? set["name"] : null,
    units,
    encoders: ENCODERS.find((kind) => kind === set["encoders"]) ?? null,
    observations: observations.length,
    targets: [...new Set(readings.map((r) => r["target"]).filter((t): t is string => typeof t === "string"))],
    forces: force ? extent(observations.map((o) => force * norm(vector(o["force"]) ?? NOTHING))) : null,
    sigma: length && typeof noise === "number" ? noise * length : null,
    noise: isFields(given["instrument"]) ? "instrument" : readings.some(readingStatesNoise) ? "readings" : null,
    framed: isFields(set["frame"]),
    loadPoint: length && point ? times(point, length) : null,
    firstJoints: angle && joints ? joints.map((one) => one * angle) : null,
  };
}

/** The force of an observation that states none. */
const NOTHING: Vector = [Number.NaN, 0, 0];

const readingStatesNoise = (reading: Fields): boolean =>
  Object.keys(reading).some((key) => /sigma|covariance/.test(key) && reading[key] !== null);

/** The factor of a stated unit to SI; null where its word is none. */
export const factorOf = (units: Facts["units"], of: keyof Units): number | null =>
  Object.entries(UNITS[of]).find(([word]) => word === units?.[of])?.[1] ?? null;

function vector(value: unknown): Vector | null {
  const list = numbers(value);
  return list?.length === 3 ? (list as unknown as Vector) : null;
}

function numbers(value: unknown): number[] | null {
  return Array.isArray(value) && value.length > 0 && value.every((v) => typeof v === "number") ? value : null;
}

/** Texts of a form; a blank one is nothing. */
export type Typed = Record<keyof Metadata, string>;

/** The texts of a form that shows what is noted. */
export function typedOf(noted: Partial<Metadata>): Typed {
  const texts = Object.fromEntries(METADATA.map((name) => [name, noted[name] ?? ""])) as Typed;
  return { ...texts, measured_at: noted.measured_at ? localTime(noted.measured_at) : "" };
}

/** What a form says; null where it says nothing. Null for the whole while its time is none. */
export function notedIn(typed: Typed): Metadata | null {
  const at = typed.measured_at === "" ? null : new Date(typed.measured_at);
  if (at !== null && Number.isNaN(at.getTime())) return null;
  const texts = Object.fromEntries(METADATA.map((name) => [name, typed[name].trim() || null]));
  return { ...texts, measured_at: at === null ? null : at.toISOString() } as Metadata;
}

/** A time as the browser's field for a date and a time takes it: of this device's zone, to the minute. */
function localTime(time: string): string {
  return new Date(time).toLocaleString("sv").slice(0, 16).replace(" ", "T"); // Swedish is written as in ISO 8601
}

/** The start of a day of this device, some days later; null for no day. */
function startOf(day: string, later = 0): string | null {
  const [year = 0, month = 1, date = 1] = day.split("-").map(Number);
  return day === "" ? null : new Date(year, month - 1, date + later).toISOString();
}

/** The filter of sets that were measured on or between two days. */
export const measuredBetween = ({ from, to }: { from: string; to: string }) => ({
  measured_from: startOf(from),
  measured_to: startOf(to, 1),
});

type Noise = NonNullable<MeasurementSet["noise"]>;

/** What is stated of it; `residuals`: the tracker's noise is to be estimated from them. */
export type StatedNoise = Fields & { residuals?: boolean };

/** Whether anything is stated that the readings do not say. */
export const statesNoise = (noise: StatedNoise): boolean =>
  Object.values(noise).some((value) => isStated(value) && value !== false);

/** Zero is stated: it is known exactly. */
const isStated = (value: unknown): boolean => value !== null && value !== undefined;

/** The noise to post with a set in `units` that had the noise `before`. */
export function noiseOf({ residuals, ...asked }: StatedNoise, before: Noise | null, units: Units): unknown {
  const { length, angle } = factors(units);
  const { sigma, instrument, encoder_sigma: encoder, load_point: point, target_places: places } = asked;
  const { drift, force, repeatability } = asked;
  const [load, grounds] = [stated(force), stated(asked["grounds"])];
  const { station, range, transverse } = (instrument ?? {}) as Record<string, Fields>;
  const part = (of: Fields | undefined) => ({
    constant: sized(of?.["constant"] ?? 0, 1 / length),
    per_distance: of?.["per_distance"] ?? 0,
  });
  const noise = {
    ...before,
    ...(residuals || isStated(sigma) || instrument ? { sigma: null, instrument: null } : {}),
    ...(isStated(sigma) || instrument ? { refuted: null } : {}),
    ...(isStated(sigma) ? { sigma: sized(sigma, 1 / length) } : {}),
    ...(instrument
      ? { instrument: { station: sized(station, 1 / length) ?? [], range: part(range), transverse: part(transverse) } }
      : {}),
    ...(isStated(encoder) ? { encoder_sigma: sized(encoder, 1 / angle) } : {}),
    ...(isStated(point) ? { load_point: sized(point, 1 / length) } : {}),
    ...(isStated(places) ? { target_places: sized(places, 1 / length) } : {}),
    ...(isStated(drift) ? { drift: sized(drift, 1 / length) } : {}),
    ...(isStated(repeatability) ? { repeatability: sized(repeatability, 1 / angle) } : {}),
    ...(isFields(load) && Object.keys(load).length > 0 ? { force: load } : {}),
    ...(isFields(grounds) && Object.keys(grounds).length > 0 ? { grounds: { ...before?.grounds, ...grounds } } : {}),
  };
  const said = Object.entries(noise).filter(([, value]) => value !== null && value !== undefined && value !== false);
  return said.length === 0 ? null : Object.fromEntries(said);
}
