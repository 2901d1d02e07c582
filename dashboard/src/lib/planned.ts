/** A plan: what a person asks for, the campaign to fill in, and what has been read of it. */
import type { MeasurementSet, PlanRequest, PlanResult } from "../api/types";
import type { Fields } from "./json";
import { factors } from "./units";
import { type Vector, norm, times } from "./vector";

export type Planned = PlanResult["readings"][number];

/** The equipment of a campaign, to begin another one with: its targets, its load point and its strongest load, in SI. */
export function equipmentOf(set: MeasurementSet): Fields {
  const { length, force: unit } = factors(set.units);
  const metres = (place: readonly number[]) => place.map((part) => Number((length * part).toFixed(6)));
  const forces = set.observations.map(({ force }) => times(force as Vector, unit));
  const strongest = forces.reduce<Vector>((best, force) => (norm(force) > norm(best) ? force : best), [0, 0, 0]);
  const hangs = forces.every(([x, y, z]) => z <= 0 && Math.hypot(x, y) <= 1e-3 * norm(strongest));
  const point = set.load_point ?? set.observations[0]?.load_point;
  const targets = Object.entries(set.flange_targets ?? {}).map(([name, place]) => [name, metres(place)]);
  return {
    ...(targets.length > 0 ? { targets: Object.fromEntries(targets) } : {}),
    ...(point ? { load_point: metres(point) } : {}),
    ...(norm(strongest) > 0
      ? { load: { kind: hangs ? "dead_weight" : "any_direction", force: Math.round(norm(strongest)) } }
      : {}),
  };
}

/** What was found of the fields that are still as they began. */
export const unchanged = (found: Fields, now: Fields, start: Fields): Fields =>
  Object.fromEntries(Object.entries(found).filter(([name]) => now[name] === start[name]));

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
