/** Estimates as people read them: a number and its interval, in the digits that the interval allows. */
import { text } from "../words";
import { decimalsFor, fixed, percent, significant } from "./format";

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
  /** Half of the interval, relative to the number; null without both ends. */
  relative: number | null;
}

/** Half-width of a 95 % interval in standard uncertainties. */
export const NORMAL_95 = 1.959964;

/** Half-width of an interval relative to its number, where no goal is stated: wider ones are to be used with care. */
export const GOAL = 0.2;

/** Ratio of the distances to both ends below which a number is at an end of its interval. */
const AT_AN_END = 0.01;

/** What decides the digits: half of the distance to the nearer end, for a number at an end to the other; null where it is unknown. */
function spreadOf(value: number, ends: Ends): number | null {
  const sides = ends.flatMap((end) => (end === null || !Number.isFinite(end) ? [] : [Math.abs(end - value)]));
  if (sides.length === 0 || !Number.isFinite(value)) return null;
  const [near, far] = [Math.min(...sides), Math.max(...sides)];
  return (near < AT_AN_END * far ? far : near) / 2 || null;
}

/** Half of an interval relative to its number; null where an end is open. */
function relativeOf(value: number, ends: Ends | null): number | null {
  const [low, high] = ends ?? [null, null];
  if (low === null || high === null || !Number.isFinite(high - low) || value === 0) return null;
  return Math.abs((high - low) / 2 / value);
}

const NONE: ShownEstimate = { value: null, interval: null, limit: null, unusable: false, relative: null };

/** A number with its interval, both in the unit that is shown. */
export function shownEstimate(value: number | null, ends: Ends | null, unusable = false): ShownEstimate {
  if (value === null || Number.isNaN(value)) return { ...NONE, unusable };
  const spread = ends && spreadOf(value, ends);
  const show = (each: number) => (spread === null ? significant(each, 3) : fixed(each, decimalsFor(spread)));
  const interval = ends ? ends.map((end) => (end === null ? text.estimate.noLimit : show(end))).join(" … ") : null;
  return {
    ...NONE,
    value: show(value),
    interval: interval ?? text.estimate.noInterval,
    unusable,
    relative: relativeOf(value, ends),
  };
}

/** A number of which only the half-width of its interval is known, relative to it. */
export function shownWithin(value: number, relative: number): ShownEstimate {
  const shown = shownEstimate(value, [value * (1 - relative), value * (1 + relative)]);
  return { ...shown, relative };
}

/** A length of a table with its ends, of which those that are unknown are NaN. */
export const boundedLength = (value: number, [low, high]: readonly [number, number]): ShownEstimate =>
  shownEstimate(value, Number.isFinite(high) ? [low, high] : null);

/** A relative change with its 95 % interval, in per cent; the sign is written. */
export function shownChange(value: number, uncertainty: number | null): ShownEstimate {
  const half = uncertainty === null ? null : 100 * NORMAL_95 * uncertainty;
  const shown = shownEstimate(100 * value, half === null ? null : [100 * value - half, 100 * value + half]);
  return { ...shown, value: `${value > 0 ? "+" : ""}${shown.value}` };
}

/** A number and its interval in one line: `3.07 (2.97 … 3.18)`; the interval does not break. */
export function estimateText({ value, interval, limit }: ShownEstimate): string {
  if (limit !== null) return limit;
  if (value === null) return "–";
  return `${value} ${rangeText(interval)}`;
}

export const rangeText = (interval: string | null): string =>
  interval === null ? "" : `(${interval.replaceAll(" ", "\u00a0")})`;

/** The width of an interval in words: `± 12 %`; what is as wide as its number is not counted. */
export const widthText = (relative: number): string => `± ${relative > 1 ? "> 100\u00a0%" : percent(relative)}`;
