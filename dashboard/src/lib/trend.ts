/** A trend as the page says it: changes with their uncertainty, and what the charts draw. */
import type { Estimate, Trend, TrendJoint } from "../api/types";
import type { TrendPoint } from "../views/trend";
import { decimalsFor, fixed } from "./format";
import { intervalIn, maybeInUnit, type StiffnessUnit } from "./stiffness";

/** A relative change as per cent with its standard uncertainty. */
export function changeText({ value: relative, standard_uncertainty }: Estimate): string {
  const u = standard_uncertainty ?? 0;
  const decimals = Math.max(0, decimalsFor(100 * u));
  return `${relative > 0 ? "+" : ""}${fixed(100 * relative, decimals)} ± ${fixed(100 * u, decimals)}\u00a0%`;
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
    const value = maybeInUnit(point?.stiffness, unit, joint.kind);
    const [low, high] = intervalIn(point?.interval, unit, joint.kind);
    return {
      time: Date.parse(campaign.at),
      value,
      low,
      high: point?.interval ? high : value,
      mark: point?.reason === null ? "method-1" : "free",
      lines: say(i),
      open: open(campaign.run_id),
    };
  });
}
