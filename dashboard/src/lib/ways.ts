/** How runs were made, in words. */
import type { RunRequest, RunSummary } from "../api/types";
import { text } from "../words";

type Asked = Pick<RunSummary, "method" | "positive" | "weighting" | "elasticity"> &
  Partial<Pick<RunRequest, "loss" | "complementary_stiffness" | "leave_out" | "variant_of">>;

/** How a run was made: its method, then what is not usual. */
export const waysOf = ({
  positive,
  weighting,
  elasticity,
  leave_out: left = [],
  variant_of: origin,
  ...asked
}: Asked): string[] => [
  positive ? text.options.constrained : text.options.unconstrained,
  ...(weighting === "covariance" ? [] : [text.weightings[weighting]]),
  ...(elasticity === "joints" || elasticity === "automatic" ? [] : [text.elasticities[elasticity]]),
  ...(asked.loss && asked.loss !== "automatic" ? [text.assessment.loss[asked.loss]] : []),
  ...(asked.complementary_stiffness === "neglected" ? [text.assessment.neglected] : []),
  ...(left.length > 0 ? [text.lists.without(left)] : []),
  ...(origin ? [text.assessment.variant] : []),
];

export const howOf = (run: Asked): string => [text.methods[run.method], ...waysOf(run)].join(", ");
