/** What is said of a joint in words: kinds here, the words in src/i18n. */
import type { JointResult, Usability } from "../api/types";

export type Verdict = "firm" | "fair" | "rough" | "unrated" | "vague" | "lower_limit" | "negative" | "unobservable";

/** Relative half width of the interval below which a stiffness is called firm, fair. */
const FIRM = 0.05;
const FAIR = 0.2;

/** Standard uncertainty over compliance above which a value without interval says hardly anything. */
const VAGUE = 0.5;

export function verdictOf(joint: JointResult): Verdict {
  if (joint.status === "not_observable" || joint.compliance === null) return "unobservable";
  if (joint.compliance < 0) return "negative";
  const interval = joint.stiffness_interval;
  if (joint.stiffness === null) return "lower_limit";
  if (!interval) return (joint.standard_uncertainty ?? 0) > VAGUE * joint.compliance ? "vague" : "unrated";
  if (interval[1] === null) return "lower_limit";
  const halfWidth = (interval[1] - interval[0]) / 2 / joint.stiffness;
  return halfWidth <= FIRM ? "firm" : halfWidth <= FAIR ? "fair" : "rough";
}

/** Standard uncertainty of the stiffness, to first order: u(k) = k² u(c). Null where nothing is known. */
export function stiffnessUncertainty(joint: JointResult): number | null {
  if (joint.stiffness === null || joint.standard_uncertainty === null) return null;
  return joint.stiffness ** 2 * joint.standard_uncertainty;
}

/** Stiffer than this, at the run's confidence; null where nothing is known. */
export function lowerLimit(joint: JointResult): number | null {
  return joint.one_sided?.stiffness_at_least ?? joint.stiffness_interval?.[0] ?? null;
}

const SEVERITY: Record<Usability, number> = { use: 0, use_with_care: 1, do_not_use: 2 };
const ALLOWS: Record<Verdict, Usability> = {
  firm: "use",
  fair: "use",
  rough: "use_with_care",
  unrated: "use_with_care",
  vague: "use_with_care",
  lower_limit: "use_with_care",
  negative: "do_not_use",
  unobservable: "do_not_use",
};

/** The assessment of a joint where it is worse than its numbers look by themselves; else null. */
export function capOf(joint: JointResult): Usability | null {
  return SEVERITY[joint.verdict] > SEVERITY[ALLOWS[verdictOf(joint)]] ? joint.verdict : null;
}
