import { describe, expect, it } from "vitest";
import type { JointResult, MeasurementSet, Posture } from "../src/api/types";
import { contributions, shares } from "../src/pure/contributions";
import { norm } from "../src/pure/vector";

/** Two levers of 1 m in the plane y = 0, turning about y: worked out by hand. */
const POSTURE: Posture = {
  joint_origins: [
    [0, 0, 0],
    [1, 0, 0],
  ],
  joint_axes: [
    [0, 1, 0],
    [0, 1, 0],
  ],
  flange_origin: [2, 0, 0],
  flange_axes: [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
  ],
};
const SET = {
  units: { length: "mm", angle: "rad", force: "kN" },
  load_point: [0, 0, 0],
  flange_targets: { tcp: [0, 0, 0] },
  observations: [
    { label: "1", joints: [0, 0], force: [0, 0, -1], readings: [{ target: "tcp", deflection: [0, 0, -1] }] },
  ],
} as unknown as MeasurementSet;
const joint = (name: string, compliance: number | null) => ({ name, compliance }) as JointResult;

describe("what each joint contributes", () => {
  it("is torque times compliance times lever", () => {
    // 1 kN down at 2 m and at 1 m: 2000 and 1000 N.m; levers of 2 and 1 m
    const [moved] = contributions(SET, [POSTURE], [joint("a", 1e-6), joint("b", 4e-6)]);
    expect(moved?.place).toEqual([2, 0, 0]);
    expect(moved?.byJoint[0]?.[2]).toBeCloseTo(-0.004, 12);
    expect(moved?.byJoint[1]?.[2]).toBeCloseTo(-0.004, 12);
    expect(shares([moved!], ["a", "b"]).map((part) => part.share)).toEqual([0.5, 0.5]);
  });
  it("adds up to the whole deflection, and to one", () => {
    const parts = shares(contributions(SET, [POSTURE], [joint("a", 1e-6), joint("b", -3e-7)]), ["a", "b"]);
    expect(parts.reduce((sum, part) => sum + part.share, 0)).toBeCloseTo(1, 12);
    expect(parts[1]?.share).toBeLessThan(0);
  });
  it("takes readings and loads out of a tracker's frame", () => {
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
    const readings = [{ target: "tcp", unloaded: [0, -1000, 0] }];
    const observations = [{ label: "1", joints: [0, 0], force: [0, 0, -1], readings }];
    const set = {
      ...SET,
      frame: { forces: "tracker" },
      resolved_frame: resolved,
      observations,
    } as unknown as MeasurementSet;
    const [moved] = contributions(set, [POSTURE], [joint("a", 1e-6), joint("b", 4e-6)]);
    expect(moved?.place).toEqual([2, 0, 0]);
    expect(moved?.byJoint[1]?.[2]).toBeCloseTo(-0.004, 12);
  });
  it("counts a joint without a number as rigid", () => {
    const [moved] = contributions(SET, [POSTURE], [joint("a", null), joint("b", 1e-6)]);
    expect(norm(moved!.byJoint[0]!)).toBe(0);
  });
});
