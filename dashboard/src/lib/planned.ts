/** A plan: what a person asks for, the campaign to fill in, and what has been read of it. */
import type { MeasurementSet, PlanRequest, PlanResult } from "../api/types";
import type { Fields } from "./json";
import { factors } from "./units";
import { type Vector, norm, times } from "./vector";

export type Planned = PlanResult["readings"][number];

/** What a person asks for, in the units of a workshop: mm, N, µm. */
export interface Asked {
  targets: string;
  loadPoint: string;
  station: string;
  sigma: string;
  kind: "dead_weight" | "any_direction" | "cable";
  force: string;
  anchors: string;
  floor: string;
  readings: string;
  joints: string[];
}

/** The equipment of a campaign, to begin another one with: its targets, its load point and its strongest load. */
export function equipmentOf(set: MeasurementSet): Partial<Asked> {
  const { length, force: unit } = factors(set.units);
  const mm = (place: readonly number[]) => place.map((part) => Number((1e3 * length * part).toFixed(3))).join(" ");
  const forces = set.observations.map(({ force }) => times(force as Vector, unit));
  const strongest = forces.reduce<Vector>((best, force) => (norm(force) > norm(best) ? force : best), [0, 0, 0]);
  const hangs = forces.every(([x, y, z]) => z <= 0 && Math.hypot(x, y) <= 1e-3 * norm(strongest));
  const point = set.load_point ?? set.observations[0]?.load_point;
  return {
    targets: Object.entries(set.flange_targets ?? {})
      .map(([name, place]) => `${name} ${mm(place)}`)
      .join("\n"),
    ...(point ? { loadPoint: mm(point) } : {}),
    kind: hangs ? "dead_weight" : "any_direction",
    force: norm(strongest) > 0 ? String(Math.round(norm(strongest))) : "",
  };
}

/** Numbers of a line, in m; null if they are not three. */
export function point(line: string): [number, number, number] | null {
  const found = line.trim().split(/[\s;,]+/);
  const numbers = found.map((part) => Number(part) / 1e3);
  return found.length === 3 && found.every(Boolean) && numbers.every(Number.isFinite)
    ? (numbers as [number, number, number])
    : null;
}

/** Targets of lines `name x y z`; the first line that is none comes back as text. */
export function targetsOf(lines: string): { [name: string]: [number, number, number] } | string {
  const targets: { [name: string]: [number, number, number] } = {};
  for (const line of lines.split("\n").filter((each) => each.trim())) {
    const [name = "", ...rest] = line.trim().split(/[\s;,]+/);
    const place = point(rest.join(" "));
    if (!place) return line.trim();
    targets[name] = place;
  }
  return targets;
}

/** The request without its subject; what is left empty is left to the service or to the campaign. */
export function optionsOf(asked: Asked): Fields | string {
  const targets = targetsOf(asked.targets);
  if (typeof targets === "string") return targets;
  const points: Fields = {};
  for (const [name, line] of [
    ["load_point", asked.loadPoint],
    ["station", asked.station],
  ] as const) {
    const place = line.trim() ? point(line) : null;
    if (line.trim() && !place) return line.trim();
    if (place) points[name] = place;
  }
  const anchors = asked.anchors.split("\n").filter((line) => line.trim());
  const places = anchors.map(point);
  const missing = places.indexOf(null);
  if (asked.kind === "cable" && missing >= 0) return anchors[missing] ?? "";
  const sigma = asked.sigma.trim() ? Number(asked.sigma) / 1e6 : null;
  const { station, ...others } = points;
  const kilograms = /^\s*([\d.]+)\s*kg\s*$/.exec(asked.force);
  const uncertainty = { constant: sigma ?? 2e-5, per_distance: 0 };
  return {
    ...others,
    readings: Number(asked.readings),
    ...(asked.joints.length > 0 ? { joints: asked.joints } : {}),
    ...(Object.keys(targets).length > 0 ? { targets } : {}),
    ...(station ? { tracker: { station, range: uncertainty, transverse: uncertainty } } : sigma ? { sigma } : {}),
    ...(asked.force.trim()
      ? {
          load: {
            kind: asked.kind,
            ...(asked.kind === "dead_weight" && kilograms
              ? { mass: Number(kilograms[1]) }
              : { force: Number(asked.force) }),
            ...(asked.kind === "cable" ? { anchors: places } : {}),
          },
        }
      : {}),
    ...(asked.floor.trim() ? { surroundings: { floor: Number(asked.floor) / 1e3 } } : {}),
  };
}

/** A campaign to fill in: the set so far with the planned readings after it, whose positions are null. */
export function toFillIn(
  request: PlanRequest,
  readings: Planned[],
  robotId: string,
  base: MeasurementSet | null,
): Fields {
  const unit = base ? factors(base.units) : { length: 1, angle: 1, force: 1 };
  const over = (values: readonly number[], factor: number) => values.map((value) => value / factor);
  const before = base?.observations ?? [];
  const named = Object.keys(request.targets);
  const targets = named.length > 0 ? named : [...new Set(before.flatMap((o) => o.readings.map((r) => r.target)))];
  const planned = readings.map((each) => ({
    label: each.label,
    joints: over(each.joints, unit.angle),
    force: over(each.force, unit.force),
    readings: targets.map((target) => ({ target, unloaded: null, loaded: null })),
  }));
  if (base) {
    const { id, archived, created_at, content_hash, warnings, resolved_frame, ...document } = base;
    return { ...document, observations: [...before, ...planned] };
  }
  return {
    robot_id: robotId,
    name: "planned campaign",
    units: { length: "m", angle: "rad", force: "N" },
    encoders: "motor",
    ...(request.sigma === null ? {} : { noise: { sigma: request.sigma } }),
    load_point: request.load_point ?? [0, 0, 0],
    observations: planned,
  };
}

/** The set with those observations only whose readings are all there; null if there is none. */
export function readSoFar(set: Fields): { document: Fields; labels: string[] } | null {
  const observations = (Array.isArray(set["observations"]) ? set["observations"] : []).filter(isRead);
  if (observations.length === 0) return null;
  return { document: { ...set, observations }, labels: observations.map((each) => String(each["label"])) };
}

function isRead(observation: unknown): observation is Fields {
  if (typeof observation !== "object" || observation === null) return false;
  const { readings } = observation as { readings?: unknown };
  return (
    Array.isArray(readings) &&
    readings.length > 0 &&
    readings.every((reading: Fields) =>
      Object.entries(reading).every(
        ([key, value]) =>
          !POSITION.test(key) || value !== null || (key === "deflection" && Array.isArray(reading["unloaded"])),
      ),
    )
  );
}

const POSITION = /^(unloaded|loaded|deflection)$/;
