/** Numbers and times as people read them: the uncertainty decides the digits (GUM 7.2.6), thousands in groups. */

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

/** A p value, which no one needs to ten digits. */
export function pValue(p: number): string {
  return p < 0.001 ? "< 0.001" : fixed(p, p < 0.1 ? 3 : 2);
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
