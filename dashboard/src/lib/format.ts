/** Numbers and times as people read them: the uncertainty decides the digits (GUM 7.2.6), thousands in groups; axes with round numbers. */

import { text } from "../words";

const GROUP = "\u202f"; // narrow no-break space, as ISO 80000 wants it
const MINUS = "\u2212";

/** Digits after the point that show two significant digits of an uncertainty; negative for tens, hundreds, … */
export function decimalsFor(uncertainty: number): number {
  if (!(uncertainty > 0) || !Number.isFinite(uncertainty)) return 0;
  const decimals = 1 - Math.floor(Math.log10(uncertainty));
  const rounded = roundTo(uncertainty, decimals); // 0.0996 is 0.10, which has a digit less
  return Math.floor(Math.log10(rounded)) > Math.floor(Math.log10(uncertainty)) ? decimals - 1 : decimals;
}

function roundTo(value: number, decimals: number): number {
  if (decimals >= 0) return Number(value.toFixed(Math.min(decimals, 20)));
  const step = 10 ** -decimals;
  return Math.round(value / step) * step;
}

/** A number with so many digits after the point; a negative count rounds to tens, hundreds, … */
export function fixed(value: number, decimals: number): string {
  if (!Number.isFinite(value)) return Number.isNaN(value) ? "–" : value > 0 ? "∞" : `${MINUS}∞`;
  const digits = roundTo(Math.abs(value), decimals).toFixed(Math.max(0, Math.min(decimals, 20)));
  const [whole = "0", fraction] = digits.split(".");
  const grouped = whole.length > 4 ? whole.replace(/\B(?=(\d{3})+$)/g, GROUP) : whole;
  const shown = fraction === undefined ? grouped : `${grouped}.${fraction}`;
  return value < 0 && /[1-9]/.test(digits) ? MINUS + shown : shown;
}

/** A number with so many significant digits, in powers of ten where it is very large or small. */
export function significant(value: number, digits = 3): string {
  if (value === 0 || !Number.isFinite(value)) return fixed(value, 0);
  const exponent = Math.floor(Math.log10(Math.abs(Number(value.toPrecision(digits)))));
  if (exponent < -4 || exponent > 7)
    return `${fixed(value / 10 ** exponent, digits - 1)}\u00d710${superscript(exponent)}`;
  return fixed(value, digits - 1 - exponent);
}

function superscript(value: number): string {
  return [...String(value)].map((c) => (c === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[Number(c)])).join("");
}

/** A share as per cent, with a digit more near 100, and below 1 as many as it takes. */
export function percent(share: number): string {
  const value = share * 100;
  const size = Math.abs(value);
  if (size > 0 && size < 1) return `${size < 0.001 ? "< 0.001" : significant(value, 1)}\u00a0%`;
  return `${fixed(value, size >= 99 && size < 100 ? 1 : 0)}\u00a0%`;
}

/** A p value as a relation, which no one needs to ten digits. */
export function pValue(p: number): string {
  return p < 0.001 ? "p < 0.001" : `p = ${fixed(p, p < 0.1 ? 3 : 2)}`;
}

/** Text cut to a length, for places that cannot wrap. */
export function clip(name: string, length: number): string {
  const characters = [...name];
  return characters.length > length ? `${characters.slice(0, length - 1).join("")}…` : name;
}

export interface Mark {
  /** Units that were done. */
  done: number;
  /** When, in milliseconds. */
  at: number;
}

/** Seconds left at the speed between two marks; null while that cannot be said. */
export function secondsLeft(first: Mark, last: Mark, total: number): number | null {
  const speed = (last.done - first.done) / (last.at - first.at);
  return speed > 0 && Number.isFinite(speed) ? Math.max(0, total - last.done) / speed / 1000 : null;
}

/** A time in words that suit its size: 5 s, 40 s, 3 min, 2 h. */
export function roughTime(seconds: number): string {
  if (seconds < 10) return `${Math.max(1, Math.round(seconds))} s`;
  if (seconds < 90) return `${10 * Math.round(seconds / 10)} s`;
  return seconds < 5400 ? `${Math.round(seconds / 60)} min` : `${Math.round(seconds / 3600)} h`;
}

export interface Scale {
  (value: number): number;
  ticks: number[];
}

/** A round step of 1, 2 or 5 times a power of ten, for about so many intervals. */
export function roundStep(span: number, intervals: number): number {
  const raw = span / Math.max(1, intervals);
  const power = 10 ** Math.floor(Math.log10(raw));
  const lead = raw / power;
  return (lead <= 1 ? 1 : lead <= 2 ? 2 : lead <= 5 ? 5 : 10) * power;
}

/** A linear axis, widened to round ends. */
export function linear(low: number, high: number, from: number, to: number, intervals = 5): Scale {
  const [a, b] = high > low ? [low, high] : [low - 1, low + 1];
  const step = roundStep(b - a, intervals);
  const [first, last] = [Math.floor(a / step + 1e-9), Math.ceil(b / step - 1e-9)];
  const ticks = Array.from({ length: last - first + 1 }, (_, i) => Number(((first + i) * step).toPrecision(12)));
  const place = (value: number) => from + ((value / step - first) / (last - first)) * (to - from);
  return Object.assign(place, { ticks });
}

/** A logarithmic axis of positive values, with ticks at 1, 2 and 5 where they are few, else at powers of ten. */
export function logarithmic(low: number, high: number, from: number, to: number, most = 7): Scale {
  const [a, b] = low < high ? [low, high] : [low / 2, high * 2];
  const span = Math.log10(b / a);
  const place = (value: number) => from + (Math.log10(value / a) / span) * (to - from);
  const decades = logTicks(a, b, [1]);
  const every = Math.ceil(decades.length / most);
  const ticks =
    [[1, 2, 5], [1, 3], [1]]
      .map((leads) => logTicks(a, b, leads))
      .find(({ length }) => length <= most && length >= 3) ??
    (decades.length < 2 ? evenTicks(a, b, Math.min(most, 5)) : decades.filter((_, i) => i % every === 0));
  return Object.assign(place, { ticks });
}

/** Round numbers in even steps: for axes of less than a decade, on which 1, 2 and 5 are too few. */
function evenTicks(low: number, high: number, intervals: number): number[] {
  const step = roundStep(high - low, intervals);
  const ticks: number[] = [];
  for (let i = Math.ceil(low / step); i * step <= high; i++) ticks.push(Number((i * step).toPrecision(6)));
  return ticks.filter((tick) => tick > 0);
}

function logTicks(low: number, high: number, leads: number[]): number[] {
  const ticks: number[] = [];
  for (let e = Math.floor(Math.log10(low)); e <= Math.ceil(Math.log10(high)); e++) {
    ticks.push(...leads.map((lead) => Number((lead * 10 ** e).toPrecision(6))));
  }
  return ticks.filter((tick) => tick >= low * (1 - 1e-9) && tick <= high * (1 + 1e-9));
}

/** Width of a letter of a tick's name [px]. */
const LETTER = 9;

/** Ticks of an axis with their names, without those whose name would touch that of the tick before. */
export function namedTicks(axis: Scale, nameOf: (tick: number) => string): { x: number; name: string }[] {
  const named: { x: number; name: string }[] = [];
  for (const { x, name } of axis.ticks.map((tick) => ({ x: axis(tick), name: nameOf(tick) }))) {
    const last = named.at(-1);
    if (!last || x - last.x > (LETTER * (name.length + last.name.length + 1)) / 2) named.push({ x, name });
  }
  return named;
}

/** Least and greatest of the values that are finite. */
export function extent(values: Iterable<number>): [number, number] | null {
  let [low, high] = [Infinity, -Infinity];
  for (const value of values) {
    if (!Number.isFinite(value)) continue;
    low = Math.min(low, value);
    high = Math.max(high, value);
  }
  return low <= high ? [low, high] : null;
}

/** A day, or a time, in the language of the page and in the zone of its reader. */
export const dayText = (time: string | number): string =>
  new Date(time).toLocaleDateString(text.dates, { dateStyle: "medium" });
export const timeText = (time: string): string =>
  new Date(time).toLocaleString(text.dates, { dateStyle: "medium", timeStyle: "short" });
/** A time to the second, with its zone. */
export const zonedText = (time: string): string =>
  new Date(time).toLocaleString(text.dates, { dateStyle: "medium", timeStyle: "long" });
