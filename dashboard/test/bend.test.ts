import { describe, expect, it } from "vitest";
import type { Posture } from "../src/api/types";
import { bendOf, bent } from "../src/lib/vector";

/** Two joints about y, one metre apart along x, the flange a metre further. */
const ARM = {
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
} as unknown as Posture;

describe("the bent arm", () => {
  it("gives way by compliance times lever times force", () => {
    const load = { point: [2, 0, 0], force: [0, 0, -100] } as const;
    // torque about +y of a force down at x: 100 N x 2 m and x 1 m, which turns the tip down
    for (const angle of bendOf(ARM, [1e-6, 2e-6], load)) expect(angle).toBeCloseTo(2e-4, 12);
  });
  it("slides along the axis of a prismatic joint, by compliance times the force along it", () => {
    const slide = { ...ARM, joint_kinds: ["revolute", "prismatic"] } as Posture;
    const load = { point: [2, 0, 0], force: [30, -100, 0] } as const;
    expect(bendOf(slide, [0, 2e-6], load)[1]).toBeCloseTo(-2e-4, 12);
    const moved = bent(slide, [Math.PI / 2, 0.25]);
    moved.flange_origin.forEach((value, i) => expect(value).toBeCloseTo([0, 0.25, -2][i] as number));
  });
  it("turns what each joint carries", () => {
    const quarter = bent(ARM, [0, Math.PI / 2]);
    expect(quarter.joint_origins[1]).toEqual([1, 0, 0]);
    quarter.flange_origin.forEach((value, i) => expect(value).toBeCloseTo([1, 0, -1][i] as number));
    const both = bent(ARM, [Math.PI / 2, -Math.PI / 2]);
    both.flange_origin.forEach((value, i) => expect(value).toBeCloseTo([1, 0, -1][i] as number));
    both.joint_origins[1]?.forEach((value, i) => expect(value).toBeCloseTo([0, 0, -1][i] as number));
  });
});
