/** Stiffness in the unit that was chosen, with the digits that its uncertainty allows. */
import type { JointResult } from "../api/types";
import { decimalsFor, fixed, significant } from "./format";
import { changeIn, inUnit, intervalIn, STIFFNESS_UNITS, type StiffnessUnit, unitOf } from "./units";
import { lowerLimit, stiffnessUncertainty } from "./verdict";

interface ShownStiffness {
  /** The value, of a prismatic joint with its unit, or null where there is none. */
  value: string | null;
  /** Standard uncertainty, with two significant digits. */
  uncertainty: string | null;
  /** Null for an end that is open. */
  interval: { low: string; high: string | null } | null;
  /** Stiffer than this (a compliance: less than this), where only that can be said; with its sign. */
  limit: string | null;
}

export function shownStiffness(joint: JointResult, unit: StiffnessUnit): ShownStiffness {
  const open = joint.stiffness_interval?.[1] === null;
  const u = joint.stiffness === null ? null : stiffnessUncertainty(joint);
  const { kind } = joint;
  const change = u === null || joint.stiffness === null ? null : changeIn(u, joint.stiffness, unit, kind);
  const beside = kind === "prismatic" ? `\u00a0${unitOf(unit, kind).label}` : "";
  const decimals = change === null || open ? null : decimalsFor(change);
  const show = (value: number) => (decimals === null ? significant(value, open ? 2 : 3) : fixed(value, decimals));
  const [low, high] = intervalIn(joint.stiffness_interval, unit, kind);
  const limit = lowerLimit(joint);
  return {
    value: joint.stiffness === null ? null : `${show(inUnit(joint.stiffness, unit, kind))}${beside}`,
    uncertainty: change === null || open ? null : show(change),
    interval: low === null ? null : { low: show(low), high: high === null ? null : show(high) },
    limit:
      limit === null
        ? null
        : `${STIFFNESS_UNITS[unit].inverse ? "≤" : "≥"} ${significant(inUnit(limit, unit, kind), 2)}${beside}`,
  };
}

/** A number of an axis of stiffness; the axis stays one of stiffness whatever the unit. */
export function axisStiffness(unit: StiffnessUnit): (stiffness: number) => string {
  return (stiffness) => axisNumber(inUnit(stiffness, unit));
}

const axisNumber = (value: number): string =>
  value >= 1e4 ? significant(value, 2).replace(/\.0$/, "") : String(Number(value.toPrecision(2)));
