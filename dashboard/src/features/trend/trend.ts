/** A trend as the page says it: changes with their uncertainty, and what the charts draw. */
import type { Estimate, Trend, TrendCampaign, TrendJoint } from "../../api/types";
import type { IntervalMark } from "../run/joint_table";
import { estimateText, type ShownEstimate, shownChange } from "../../lib/estimate";
import { dayText, timeText } from "../../lib/format";
import { onAxis, type StiffnessUnit } from "../../lib/stiffness";
import { trendWords } from "./words";

export interface TrendPoint extends IntervalMark {
  time: number;
}

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

/** The campaign with which the latest one is compared. */
export const firstCompared = ({ points }: TrendJoint): number =>
  Math.max(
    0,
    points.findIndex(({ reason }) => reason === null),
  );

/** The two campaigns that the test of a joint compares: those with a number; each in words. */
export function comparedText(campaigns: TrendCampaign[], { points }: TrendJoint): string {
  const words = trendWords;
  const compared = points.flatMap(({ reason }, i) => (reason === null ? [i] : []));
  const [first = 0, latest = campaigns.length - 1] = [compared[0], compared.at(-1)];
  const when = whenTexts(campaigns.map(({ at }) => at));
  const named = (i: number) => words.named(campaigns[i]?.name ?? "", when[i] ?? "");
  return words.compared(
    first === 0 ? words.first : named(first),
    latest === campaigns.length - 1 ? words.latest : named(latest),
  );
}

const sizeOf = ({ change }: TrendJoint): number =>
  change?.standard_uncertainty ? Math.abs(change.value) / change.standard_uncertainty : 0;

/** Joints as one wants to see them: those that changed first, then what changed most against its uncertainty. */
export const worstFirst = (joints: TrendJoint[]): TrendJoint[] =>
  [...joints].sort((a, b) => Number(b.changed) - Number(a.changed) || sizeOf(b) - sizeOf(a));

/** Points of a joint's chart, in a unit; `say` heads the values of the campaign of an index. */
export function pointsOf(
  trend: Trend,
  joint: TrendJoint,
  unit: StiffnessUnit,
  say: (index: number) => string[],
  open: (run: string) => string,
): TrendPoint[] {
  return trend.campaigns.map((campaign, i) => {
    const point = joint.points[i];
    return {
      time: Date.parse(campaign.at),
      ...onAxis(point ?? {}, unit, joint.kind),
      mark: point?.reason === null ? "method-1" : "free",
      lines: say(i),
      open: open(campaign.run_id),
    };
  });
}
