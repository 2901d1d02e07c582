import { describe, expect, it } from "vitest";
import type { MeasurementSet, Posture } from "../src/api/types";
import { loadOf, placesOf } from "../src/lib/vector";

const POSTURE: Posture = {
  joint_names: ["joint_1", "joint_2"],
  joint_origins: [
    [0, 0, 0],
    [1, 0, 0],
  ],
  joint_axes: [
    [0, 1, 0],
    [0, 1, 0],
  ],
  joint_kinds: ["revolute", "revolute"],
  flange_origin: [2, 0, 0],
  flange_axes: [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
  ],
};
const SET = {
  units: { length: "mm", angle: "rad", force: "kN" },
  load_point: [0, 0, 100],
  flange_targets: { tcp: [0, 0, 0] },
  observations: [
    { label: "1", joints: [0, 0], force: [0, 0, -1], readings: [{ target: "tcp", deflection: [0, 0, -1] }] },
  ],
} as unknown as MeasurementSet;

describe("loads and targets in R0", () => {
  it("are in SI, targets known by their deflection where the model has them", () => {
    const [observation] = SET.observations;
    const load = loadOf(SET, observation!, POSTURE);
    expect(load.point).toEqual([2, 0, 0.1]);
    expect(load.force).toEqual([0, 0, -1000]);
    expect(placesOf(SET, observation!, POSTURE).get("tcp")).toEqual([2, 0, 0]);
  });
  it("are taken out of a tracker's frame", () => {
    // a quarter turn about z and a metre along x
    const resolved = {
      rotation: [
        [0, -1, 0],
        [1, 0, 0],
        [0, 0, 1],
      ],
      translation: [1, 0, 0],
      flange_targets: {},
    };
    const observation = {
      label: "1",
      joints: [0, 0],
      force: [1, 0, 0],
      readings: [{ target: "tcp", unloaded: [0, -1000, 0] }],
    };
    const set = {
      ...SET,
      frame: { forces: "tracker" },
      resolved_frame: resolved,
      observations: [observation],
    } as unknown as MeasurementSet;
    expect(placesOf(set, set.observations[0]!, POSTURE).get("tcp")).toEqual([2, 0, 0]);
    const { force } = loadOf(set, set.observations[0]!, POSTURE);
    expect(force[0]).toBeCloseTo(0, 12);
    expect(force[1]).toBeCloseTo(1000, 9);
  });
});
