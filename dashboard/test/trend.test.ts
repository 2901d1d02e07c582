import { describe, expect, it } from "vitest";
import type { Trend, TrendJoint } from "../src/api/types";
import { bandsOf, changedTogether, changeText, pointsOf, worstFirst } from "../src/lib/trend";

const joint = (part: Partial<TrendJoint>): TrendJoint => ({
  name: "joint_1",
  kind: "revolute",
  state: "in_control",
  points: [],
  charts: [],
  alarms: [],
  latest: null,
  pair: null,
  ...part,
});

describe("a trend", () => {
  it("shows a change with the digits that its uncertainty allows", () => {
    expect(changeText({ relative: -0.1034, standard_uncertainty: 0.0123 })).toBe("\u221210.3 ± 1.2\u00a0%");
    expect(changeText({ relative: 0.02, standard_uncertainty: 0.31 })).toBe("+2 ± 31\u00a0%");
  });

  it("says when most joints changed alike from one campaign on", () => {
    const alarm = (relative: number, run_id = "r", until: string | null = null) =>
      joint({ alarms: [{ run_id, until, change: { relative, standard_uncertainty: 0.01 } }] as TrendJoint["alarms"] });
    const [softer, quiet] = [alarm(-0.1), joint({})];
    expect(changedTogether([softer, softer, softer, quiet, quiet])).toBe(true);
    expect(changedTogether([softer, softer, softer, quiet, quiet, quiet])).toBe(false);
    expect(changedTogether([softer, softer, quiet])).toBe(false);
    expect(changedTogether([softer, softer, alarm(0.1), quiet])).toBe(false);
    expect(changedTogether([softer, softer, alarm(-0.1, "later"), quiet])).toBe(false);
    expect(changedTogether([softer, softer, alarm(-0.1, "r", "2026-01-01T00:00:00Z"), quiet])).toBe(false);
  });

  it("puts alarms first, then the change that is largest against its uncertainty", () => {
    const change = (relative: number) => ({ latest: { relative, standard_uncertainty: 0.01 } });
    const joints = [
      joint({ name: "still", ...change(0.001) }),
      joint({ name: "moving", ...change(-0.02) }),
      joint({ name: "alarmed", state: "alarm", ...change(0.005) }),
      joint({ name: "young", state: "unjudged" }),
    ];
    expect(worstFirst(joints).map(({ name }) => name)).toEqual(["alarmed", "moving", "still", "young"]);
  });

  it("draws limits and bands in the unit that was chosen, the lower end first", () => {
    const one = joint({ charts: [{ baseline: 0, stiffness: 2e6, relative_uncertainty: 0.01, between: 0 }] });
    for (const unit of ["MNm", "compliance"] as const) {
      const [band] = bandsOf(one, unit);
      expect(band?.low).toBeLessThan(band?.high ?? 0);
      expect(Math.sqrt((band?.low ?? 0) * (band?.high ?? 0))).toBeCloseTo(unit === "MNm" ? 2 : 0.5);
    }
  });

  it("has a point for each campaign, also where there is no number", () => {
    const campaign = { run_id: "r", measurement_set_id: "s", name: "c", at: "2026-01-01T00:00:00Z", baseline: 1 };
    const trend = { campaigns: [{ ...campaign, time_source: "measured_at" }] } as unknown as Trend;
    const [point] = pointsOf(
      trend,
      joint({}),
      "MNm",
      () => ["said"],
      (run) => `#/runs/${run}`,
    );
    expect(point).toMatchObject({ value: null, limits: null, part: 1, open: "#/runs/r", alarm: false });
  });
});
