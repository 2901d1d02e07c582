/** Estimates as people read them: a number and its interval, in the digits that the interval allows. */
import { text } from "../words";
import { decimalsFor, fixed, significant } from "./format";

/** Lower and upper end; null for an end without a limit. */
export type Ends = readonly [number | null, number | null];

/** A number with its interval as texts: all that a view shows of an estimate. */
export interface ShownEstimate {
  /** Null where there is no number. */
  value: string | null;
  /** `2.97 … 3.18`, or why there is none; null where there is no number. */
  interval: string | null;
  /** `> 3.1`, where only that can be said. */
  limit: string | null;
  /** Whether the number must not be used. */
  unusable: boolean;
}

/** Half-width of a 95 % interval in standard uncertainties. */
export const NORMAL_95 = 1.959964;

/** Ratio of the distances to both ends below which a number is at an end of its interval. */
const AT_AN_END = 0.01;

/** What decides the digits: half of the distance to the nearer end, for a number at an end to the other; null where it is unknown. */
function spreadOf(value: number, ends: Ends): number | null {
  const sides = ends.flatMap((end) => (end === null || !Number.isFinite(end) ? [] : [Math.abs(end - value)]));
  if (sides.length === 0 || !Number.isFinite(value)) return null;
  const [near, far] = [Math.min(...sides), Math.max(...sides)];
  return (near < AT_AN_END * far ? far : near) / 2 || null;
}

/** A number with its interval, both in the unit that is shown. */
export function shownEstimate(value: number | null, ends: Ends | null, unusable = false): ShownEstimate {
  const none = { value: null, interval: null, limit: null, unusable };
  if (value === null || Number.isNaN(value)) return none;
  const spread = ends && spreadOf(value, ends);
  const show = (each: number) => (spread === null ? significant(each, 3) : fixed(each, decimalsFor(spread)));
  const interval = ends ? ends.map((end) => (end === null ? text.estimate.noLimit : show(end))).join(" … ") : null;
  return { ...none, value: show(value), interval: interval ?? text.estimate.noInterval };
}

/** A length of a table with its ends, of which those that are unknown are NaN. */
export const boundedLength = (value: number, [low, high]: readonly [number, number]): ShownEstimate =>
  shownEstimate(value, Number.isFinite(high) ? [low, high] : null);

/** A number and its interval in one line: `3.07 (2.97 … 3.18)`; the interval does not break. */
export function estimateText({ value, interval, limit }: ShownEstimate): string {
  if (limit !== null) return limit;
  if (value === null) return "–";
  return `${value} ${rangeText(interval)}`;
}

export const rangeText = (interval: string | null): string =>
  interval === null ? "" : `(${interval.replaceAll(" ", "\u00a0")})`;
