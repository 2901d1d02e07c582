/** Axes: from values to pixels, and the round numbers that are written at them. */

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
  for (const leads of [[1, 2, 5], [1, 3], [1]]) {
    const ticks = logTicks(a, b, leads);
    if (ticks.length <= most && ticks.length >= 3) return Object.assign(place, { ticks });
  }
  const decades = logTicks(a, b, [1]);
  if (decades.length < 2) return Object.assign(place, { ticks: evenTicks(a, b, Math.min(most, 5)) });
  const every = Math.ceil(decades.length / most);
  return Object.assign(place, { ticks: decades.filter((_, i) => i % every === 0) });
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
