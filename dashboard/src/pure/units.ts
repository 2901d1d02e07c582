/** Units the page shows, and those a file may come in. */
import type { Units } from "../api/types";

export type StiffnessUnit = "Nm" | "MNm";

/** Stiffness units people choose from: N·m/rad, or millions of them as the literature prints. */
export const STIFFNESS_UNITS: Record<StiffnessUnit, { factor: number; label: string; column: string }> = {
  MNm: { factor: 1e-6, label: "10⁶ N·m/rad", column: "1e6 N.m/rad" },
  Nm: { factor: 1, label: "N·m/rad", column: "N.m/rad" },
};

const LENGTH = { m: 1, mm: 1e-3 } as const;
const ANGLE = { rad: 1, deg: Math.PI / 180 } as const;
const FORCE = { N: 1, kN: 1e3, kgf: 9.80665 } as const;
const MOMENT = { "N.m": 1, "N.mm": 1e-3, "kN.m": 1e3, "kgf.m": 9.80665 } as const;

/** Factors to SI of a file's units. */
export function factors(units: Units): { length: number; angle: number; force: number; moment: number } {
  const length = LENGTH[units.length];
  const force = FORCE[units.force];
  return { length, angle: ANGLE[units.angle], force, moment: units.moment ? MOMENT[units.moment] : force * length };
}

export const degrees = (radians: number): number => (radians * 180) / Math.PI;
export const radians = (angle: number): number => (angle * Math.PI) / 180;
