/** Stiffness in the unit that was chosen, with the digits that its uncertainty allows. */
import type { JointResult } from "../api/types";
import { decimalsFor, fixed, significant } from "./format";
import { STIFFNESS_UNITS, type StiffnessUnit } from "./units";
import { lowerLimit, stiffnessUncertainty } from "./verdict";

export interface ShownStiffness {
  /** The value, or null where there is none. */
  value: string | null;
  /** Standard uncertainty, with two significant digits. */
  uncertainty: string | null;
  interval: { low: string; high: string | null } | null;
  /** Stiffer than this, where only that can be said. */
  limit: string | null;
}

export function shownStiffness(joint: JointResult, unit: StiffnessUnit): ShownStiffness {
  const { factor } = STIFFNESS_UNITS[unit];
  const u = stiffnessUncertainty(joint);
  const decimals = u === null ? null : decimalsFor(u * factor);
  const show = (value: number) =>
    decimals === null ? significant(value * factor, 3) : fixed(value * factor, decimals);
  const open = joint.stiffness_interval?.[1] === null;
  const limit = lowerLimit(joint);
  return {
    value: joint.stiffness === null ? null : open ? significant(joint.stiffness * factor, 2) : show(joint.stiffness),
    uncertainty: u === null || open ? null : show(u),
    interval: joint.stiffness_interval && {
      low: open ? significant(joint.stiffness_interval[0] * factor, 2) : show(joint.stiffness_interval[0]),
      high: joint.stiffness_interval[1] === null ? null : show(joint.stiffness_interval[1]),
    },
    limit: limit === null ? null : significant(limit * factor, 2),
  };
}

/** A number of an axis of stiffness. */
export function axisStiffness(unit: StiffnessUnit): (value: number) => string {
  const { factor } = STIFFNESS_UNITS[unit];
  return (value) => {
    const shown = value * factor;
    return shown >= 1e4 ? significant(shown, 1).replace(/\.0$/, "") : String(Number(shown.toPrecision(3)));
  };
}
