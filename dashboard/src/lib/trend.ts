/** A trend as the page says it: changes with their uncertainty, and what the charts draw. */
import type { Trend, TrendChange, TrendJoint, TrendState } from "../api/types";
import type { TrendBand, TrendPoint } from "../views/trend";
import { decimalsFor, fixed } from "./format";
import { intervalIn, inUnit, maybeInUnit, type StiffnessUnit } from "./stiffness";

/** A relative change as per cent with its standard uncertainty. */
export function changeText({ relative, standard_uncertainty: u }: TrendChange): string {
  const decimals = Math.max(0, decimalsFor(100 * u));
  return `${relative > 0 ? "+" : ""}${fixed(100 * relative, decimals)} ± ${fixed(100 * u, decimals)}\u00a0%`;
}

const URGENCY: Record<TrendState, number> = { alarm: 0, acknowledged: 1, in_control: 2, unjudged: 3 };

const sizeOf = ({ latest, pair }: TrendJoint): number => {
  const change = latest ?? pair?.change;
  return change ? Math.abs(change.relative) / change.standard_uncertainty : 0;
};

/** Joints as one wants to see them: those in alarm first, then what changed most against its uncertainty. */
export const worstFirst = (joints: TrendJoint[]): TrendJoint[] =>
  [...joints].sort((a, b) => URGENCY[a.state] - URGENCY[b.state] || sizeOf(b) - sizeOf(a));

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
    const value = maybeInUnit(point?.stiffness, unit, joint.kind);
    const [low, high] = intervalIn(point?.interval, unit, joint.kind);
    const limits = [point?.lower_limit, point?.upper_limit].map((one) => maybeInUnit(one, unit, joint.kind));
    const [lower, upper] = limits;
    return {
      time: Date.parse(campaign.at),
      value,
      low,
      high: point?.interval ? high : value,
      smoothed: maybeInUnit(point?.smoothed, unit, joint.kind),
      limits: typeof lower === "number" && typeof upper === "number" ? [lower, upper] : null,
      alarm: point?.exceeded ?? false,
      mark: point?.role === "monitored" ? "method-1" : "free",
      lines: say(i),
      open: open(campaign.run_id),
      part: campaign.baseline,
    };
  });
}

/** The baselines of a joint ± two standard uncertainties, in a unit. */
export function bandsOf(joint: TrendJoint, unit: StiffnessUnit): TrendBand[] {
  return joint.charts.map(({ baseline, stiffness, relative_uncertainty: u }) => {
    const ends = [Math.exp(-2 * u), Math.exp(2 * u)].map((factor) => inUnit(stiffness * factor, unit, joint.kind));
    return { part: baseline, low: Math.min(...ends), high: Math.max(...ends) };
  });
}

/** Most joints alarm from one campaign on, and the same way: its load is a likelier cause than as many gearboxes. */
export function changedTogether(joints: readonly TrendJoint[]): boolean {
  const lasting = joints.flatMap(({ alarms }) => alarms.filter(({ until }) => until === null));
  const kinds = lasting.map(({ run_id, change }) => `${run_id} ${Math.sign(change.relative)}`);
  return kinds.some((kind) => {
    const alike = kinds.filter((other) => other === kind).length;
    return alike > 2 && alike > joints.length / 2;
  });
}
