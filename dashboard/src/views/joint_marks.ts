/** A joint as a mark of a chart of stiffness. */
import type { JointResult } from "../api/types";
import type { IntervalMark } from "../charts/intervals";
import { shownStiffness } from "../lib/stiffness";
import { STIFFNESS_UNITS, type StiffnessUnit } from "../lib/units";
import { verdictOf } from "../lib/verdict";
import { text } from "../i18n";

export function markOf(joint: JointResult, mark: string, unit: StiffnessUnit): IntervalMark {
  const shown = shownStiffness(joint, unit);
  const negative = joint.stiffness !== null && joint.stiffness < 0;
  const interval = joint.stiffness_interval;
  const instead = negative ? `${text.run.negative}: ${shown.value ?? ""}` : text.verdicts[verdictOf(joint)];
  const range = shown.interval ? ` (${shown.interval.low} … ${shown.interval.high ?? "∞"})` : "";
  return {
    mark,
    value: negative ? null : joint.stiffness,
    low: interval?.[0] ?? (negative ? null : joint.stiffness),
    high: interval ? interval[1] : joint.stiffness,
    instead,
    label: `${joint.name}: ${shown.value ?? instead}${range} ${STIFFNESS_UNITS[unit].label}`,
  };
}
