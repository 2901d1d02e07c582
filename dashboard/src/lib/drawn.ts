/** Deflections of a set as arrows where the targets are, R0, SI. */
import type { MeasurementSet, Posture, Residual, RunResult } from "../api/types";
import type { Arrow } from "../scene/arrows";
import { placesOf } from "./places";
import { roundStep } from "./scale";
import { norm, type Vector } from "./vector";

export interface Arrows {
  measured: Arrow[];
  predicted: Arrow[];
  /** Lengths of the residuals [m], an arrow each. */
  residuals: number[];
  /** Names of the targets, an arrow each. */
  targets: string[];
}

export interface DrawnSet {
  byObservation: Arrows[];
  together: Arrows;
  /** Greatest length of a residual [m]. */
  worst: number;
}

/** The longest arrow is about this share of the robot's reach. */
const LONGEST = 0.22;

export function arrowsOf(set: MeasurementSet, postures: Posture[], result: RunResult): DrawnSet {
  const residuals = grouped(result.residuals);
  const byObservation = set.observations.map((observation, i): Arrows => {
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
  return {
    byObservation,
    together: {
      measured: byObservation.flatMap((a) => a.measured),
      predicted: byObservation.flatMap((a) => a.predicted),
      residuals: byObservation.flatMap((a) => a.residuals),
      targets: [],
    },
    worst: Math.max(1e-9, ...result.residuals.map((r) => norm(r.residual))),
  };
}

function grouped(residuals: Residual[]): Map<string, Residual[]> {
  const groups = new Map<string, Residual[]>();
  for (const residual of residuals) {
    const group = groups.get(residual.observation);
    if (group) group.push(residual);
    else groups.set(residual.observation, [residual]);
  }
  return groups;
}

/** A round factor by which deflections are drawn longer than they are. */
export function magnification({ together: { measured } }: DrawnSet, room: Vector[]): number {
  const longest = Math.max(1e-9, ...measured.map((arrow) => norm(arrow.along)));
  const reach = Math.max(0.2, ...room.map(norm));
  return roundStep((reach * LONGEST) / longest / 1.6, 1);
}
