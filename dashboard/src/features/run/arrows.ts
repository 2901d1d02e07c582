/** Deflections of a run as arrows at the arm, and their lengths by observation. */
import type { MeasurementSet, Posture, Residual, RunResult } from "../../api/types";
import { groupedBy } from "../../lib/json";
import { roundStep } from "../../lib/format";
import { norm, placesOf, type Vector } from "../../lib/vector";
import type { Arrow } from "../../scene/parts";

export interface Arrows {
  measured: Arrow[];
  predicted: Arrow[];
  /** Lengths of the residuals [m], an arrow each. */
  residuals: number[];
  /** Names of the targets, an arrow each. */
  targets: string[];
}

/** The longest arrow is about this share of the robot's reach. */
const LONGEST = 0.22;

/** Arrows of each observation, in the order of the set. */
export function arrowsOf(set: MeasurementSet, postures: Posture[], result: RunResult): Arrows[] {
  const residuals = groupedBy(result.residuals, ({ observation }) => observation);
  return set.observations.map((observation, i) => {
    const posture = postures[i];
    const places = posture ? placesOf(set, observation, posture) : new Map<string, Vector>();
    const found = (residuals.get(observation.label) ?? []).filter((r) => places.has(r.target));
    const from = (target: string) => places.get(target) as Vector;
    return {
      measured: found.map((r) => ({ from: from(r.target), along: r.deflection })),
      predicted: found.map((r) => ({ from: from(r.target), along: r.predicted })),
      residuals: found.map((r) => norm(r.residual)),
      targets: found.map((r) => r.target),
    };
  });
}

/** A round factor by which deflections are drawn longer than they are. */
export function magnification(drawn: Arrows[], room: Vector[]): number {
  const longest = Math.max(1e-9, ...drawn.flatMap(({ measured }) => measured.map((arrow) => norm(arrow.along))));
  const reach = Math.max(0.2, ...room.map(norm));
  return roundStep((reach * LONGEST) / longest / 1.6, 1);
}

const mean = (values: number[]): number => values.reduce((sum, value) => sum + value, 0) / values.length;

/** Mean lengths over the targets of each observation [m], in the order of the observations. */
export const byObservation = (residuals: Residual[]): { name: string; before: number; after: number }[] =>
  [...groupedBy(residuals, ({ observation }) => observation)].map(([name, own]) => ({
    name,
    before: mean(own.map(({ deflection }) => norm(deflection))),
    after: mean(own.map(({ residual }) => norm(residual))),
  }));
