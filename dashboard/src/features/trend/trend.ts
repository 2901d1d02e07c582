/** A trend as the page says it: changes with their uncertainty, and what the charts draw. */
import type { Estimate, Trend, TrendJoint } from "../../api/types";
import { estimateText, type ShownEstimate, shownChange } from "../../lib/estimate";
import { dayText, extent, timeText } from "../../lib/format";
import { text } from "../../words";
import { trendWords } from "./words";

/** A relative change as per cent with its 95 % interval: `+12 % (+8 … +16 %)`. */
export function changeText({ value, standard_uncertainty: uncertainty }: Estimate): string {
  const shown = shownChange(value, uncertainty);
  const percent = "\u00a0%";
  return uncertainty === null ? `${shown.value}${percent}` : estimateText(withPercent(shown, percent));
}

const withPercent = (shown: ShownEstimate, percent: string): ShownEstimate => ({
  ...shown,
  value: `${shown.value}${percent}`,
  interval: `${shown.interval}${percent}`,
});

/** When campaigns were, as labels that differ: by day, by time where a day repeats, by number where a time does. */
export function whenTexts(times: string[]): string[] {
  const unlike = (labels: string[]) => new Set(labels).size === labels.length;
  const labels = [times.map(dayText), times.map(timeText)];
  return labels.find(unlike) ?? times.map((time, i) => `${timeText(time)} (${i + 1})`);
}

/** Place of the campaign that the user chose to compare with; the first, if none. */
export const referencePlace = ({ campaigns, reference_set_id: id }: Pick<Trend, "campaigns" | "reference_set_id">) =>
  Math.max(
    0,
    campaigns.findIndex(({ measurement_set_id: set }) => set === id),
  );

type Compared = Pick<Trend, "campaigns" | "reference_set_id">;

/** The campaign with which the latest one is compared: the first with a number from the reference on. */
export function firstCompared(trend: Compared, { points }: TrendJoint): number {
  const from = referencePlace(trend);
  const found = points.findIndex(({ reason }, i) => i >= from && reason === null);
  return found < 0 ? from : found;
}

/** The two campaigns that the test of a joint compares: those with a number; each in words. */
export function comparedText(trend: Compared, joint: TrendJoint): string {
  const words = trendWords;
  const { campaigns } = trend;
  const first = firstCompared(trend, joint);
  const latest = joint.points.findLastIndex(({ reason }) => reason === null);
  const when = whenTexts(campaigns.map(({ at }) => at));
  const named = (i: number) => words.named(campaigns[i]?.name ?? "", when[i] ?? "");
  return words.compared(
    first === 0 ? words.first : named(first),
    latest < 0 || latest === campaigns.length - 1 ? words.latest : named(latest),
  );
}

/** Least distance of two campaigns on the axis, so that both can be seen and tapped [px]. */
const APART = 16;

/** Where campaigns stand on an axis of time: true to time, but never on each other; `timeAt` is null for one time. */
export function placesOf(
  times: number[],
  further: number[],
  from: number,
  to: number,
): { places: number[]; timeAt: ((time: number) => number) | null } {
  const [low, high] = extent([...times, ...further]) ?? [0, 0];
  const even = (i: number) => from + ((i + 0.5) / Math.max(1, times.length)) * (to - from);
  if (high === low) return { places: times.map((_, i) => even(i)), timeAt: null };
  const timeAt = (time: number) => from + ((time - low) / (high - low)) * (to - from);
  const apart = Math.min(APART, (to - from) / Math.max(1, times.length - 1));
  const places = times.map(timeAt);
  for (let i = 1; i < places.length; i++) places[i] = Math.max(places[i] ?? 0, (places[i - 1] ?? 0) + apart);
  let end = to;
  for (let i = places.length - 1; i >= 0; i--, end -= apart) places[i] = Math.min(places[i] ?? 0, end);
  return { places, timeAt };
}

const DAY = 24 * 3600 * 1000;

/** Ticks of an axis of time at round days, months or years, at most so many. */
export function ticksOf(times: number[], marks: { at: string }[], most: number): { time: number; label: string }[] {
  const [low, high] = extent([...times, ...marks.map(({ at }) => Date.parse(at))]) ?? [0, 0];
  const of = (time: number, options: Intl.DateTimeFormatOptions) =>
    new Date(time).toLocaleDateString(text.dates, options);
  const first = new Date(low);
  for (const days of [1, 2, 7, 14]) {
    if ((high - low) / DAY / days >= most) continue;
    const start = new Date(first.getFullYear(), first.getMonth(), first.getDate());
    const ticks: { time: number; label: string }[] = [];
    for (let i = 0; ; i++) {
      const time = new Date(start.getFullYear(), start.getMonth(), start.getDate() + i * days).getTime();
      if (time > high) break;
      if (time >= low) ticks.push({ time, label: of(time, { day: "numeric", month: "short" }) });
    }
    if (ticks.length > 0) return ticks;
  }
  for (const months of [1, 2, 3, 6, 12, 24, 60, 120]) {
    if ((high - low) / (30.4 * DAY) / months >= most) continue;
    const ticks: { time: number; label: string }[] = [];
    for (let month = 0; ; month += months) {
      const time = new Date(first.getFullYear(), month, 1).getTime();
      if (time > high) break;
      if (time >= low) ticks.push({ time, label: of(time, { month: "short", year: "numeric" }) });
    }
    return ticks;
  }
  return [];
}
