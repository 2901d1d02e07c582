/** How runs were made, in words. */
import type { RunRequest, RunSummary } from "../api/types";
import { text } from "../words";

type Asked = Pick<RunSummary, "method" | "positive" | "weighting" | "elasticity"> &
  Partial<Pick<RunRequest, "loss" | "complementary_stiffness" | "leave_out" | "variant_of">>;

/** How a run was made: each of its options in words. */
export const waysOf = (asked: Asked): string[] => [
  asked.positive ? text.options.constrained : text.options.unconstrained,
  ...furtherWays(asked),
];

/** What is not usual besides method and constraint. */
function furtherWays({ weighting, elasticity, leave_out: left = [], variant_of: origin, ...asked }: Asked): string[] {
  return [
    ...(weighting === "covariance" ? [] : [text.weightings[weighting]]),
    ...(elasticity === "joints" || elasticity === "automatic" ? [] : [text.elasticities[elasticity]]),
    ...(asked.loss && asked.loss !== "automatic" ? [text.assessment.loss[asked.loss]] : []),
    ...(asked.complementary_stiffness === "neglected" ? [text.assessment.neglected] : []),
    ...(left.length > 0 ? [text.lists.without(left)] : []),
    ...(origin ? [text.assessment.variant] : []),
  ];
}

/** How a run was made where it is not as usual: most runs have the partial pose, and positive stiffnesses. */
export function unusualWays(asked: Asked): string {
  const method = asked.method === "partial_pose" ? [] : [text.methods[asked.method]];
  const constraint = asked.positive ? [] : [text.options.unconstrained];
  const ways = [...method, ...constraint, ...furtherWays(asked)].join(", ");
  return ways.charAt(0).toUpperCase() + ways.slice(1);
}

export const howOf = (run: Asked): string => [text.methods[run.method], ...waysOf(run)].join(", ");
