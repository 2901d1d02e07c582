import { describe, expect, it } from "vitest";
import type { Trend, TrendJoint } from "../src/api/types";
import { changeText, pointsOf, worstFirst } from "../src/lib/trend";

const joint = (part: Partial<TrendJoint>): TrendJoint => ({
  name: "joint_1",
  kind: "revolute",
  points: [],
  change: null,
  p_value: null,
  changed: false,
  ...part,
});

describe("a trend", () => {
  it("shows a change with the digits that its uncertainty allows", () => {
    expect(changeText({ value: -0.1034, standard_uncertainty: 0.0123 })).toBe("\u221210.3 ± 1.2\u00a0%");
    expect(changeText({ value: 0.02, standard_uncertainty: 0.31 })).toBe("+2 ± 31\u00a0%");
  });

  it("puts joints that changed first, then the change that is largest against its uncertainty", () => {
    const change = (value: number) => ({ change: { value, standard_uncertainty: 0.01 } });
    const joints = [
      joint({ name: "still", ...change(0.001) }),
      joint({ name: "moving", ...change(-0.02) }),
      joint({ name: "changed", changed: true, ...change(0.005) }),
      joint({ name: "young" }),
    ];
    expect(worstFirst(joints).map(({ name }) => name)).toEqual(["changed", "moving", "still", "young"]);
  });

  it("has a point for each campaign, also where there is no number", () => {
    const campaign = { run_id: "r", measurement_set_id: "s", name: "c", at: "2026-01-01T00:00:00Z" };
    const trend = { campaigns: [{ ...campaign, time_source: "measured_at" }] } as unknown as Trend;
    const [point] = pointsOf(
      trend,
      joint({ points: [{ stiffness: null, interval: null, reason: "it is not observable" }] }),
      "MNm",
      () => ["said"],
      (run) => `#/runs/${run}`,
    );
    expect(point).toMatchObject({ value: null, mark: "free", open: "#/runs/r" });
  });
});
