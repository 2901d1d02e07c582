/** Noise of readings and load as people state it, in SI, and as a measurement set has it. */
import type { MeasurementSet, Units } from "../api/types";
import { scaled } from "./entered";
import { type Fields, isFields, stated } from "./json";
import { factors } from "./units";

type Noise = NonNullable<MeasurementSet["noise"]>;

/** What is stated of it; `residuals`: the tracker's noise is to be estimated from them. */
export type StatedNoise = Fields & { residuals?: boolean };

/** Whether anything is stated that the readings do not say. */
export const statesNoise = (noise: StatedNoise): boolean =>
  Object.values(noise).some((value) => isStated(value) && value !== false);

/** Zero is stated: it is known exactly. */
const isStated = (value: unknown): boolean => value !== null && value !== undefined;

/** Numbers times a factor; what is no number goes as it was typed. */
const sized = (value: unknown, factor: number): unknown =>
  Array.isArray(value)
    ? value.map((part) => sized(part, factor))
    : typeof value === "number"
      ? scaled(value, factor)
      : value;

/** The noise to post with a set in `units` that had the noise `before`. */
export function noiseOf({ residuals, ...asked }: StatedNoise, before: Noise | null, units: Units): unknown {
  const { length, angle } = factors(units);
  const { sigma, instrument, encoder_sigma: encoder, load_point: point, target_places: places, force } = asked;
  const load = stated(force);
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
    ...(isFields(load) && Object.keys(load).length > 0 ? { force: load } : {}),
  };
  const said = Object.entries(noise).filter(([, value]) => value !== null && value !== undefined && value !== false);
  return said.length === 0 ? null : Object.fromEntries(said);
}
