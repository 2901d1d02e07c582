import { describe, expect, it } from "vitest";
import type { Trend, TrendJoint } from "../src/api/types";
import { changeText, comparedText, pointsOf, whenTexts, worstFirst } from "../src/features/trend/trend";

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
    expect(changeText({ value: -0.1034, standard_uncertainty: 0.0123 })).toBe(
      "\u221210.3\u00a0% (\u221212.8\u00a0…\u00a0\u22127.9\u00a0%)",
    );
    expect(changeText({ value: 0.02, standard_uncertainty: 0.31 })).toBe("+2\u00a0% (\u221259\u00a0…\u00a063\u00a0%)");
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

  it("names the campaigns that a test compares where they are not the first and the latest", () => {
    const at = (day: number) => ({ name: `set ${day}`, at: `2026-01-0${day}T12:00:00Z` });
    const campaigns = [1, 2, 3, 4].map(at) as Trend["campaigns"];
    const withNumbers = (...known: number[]) =>
      joint({
        points: campaigns.map((_, i) => ({ stiffness: 1, interval: null, reason: known.includes(i) ? null : "wide" })),
      });
    expect(comparedText(campaigns, withNumbers(0, 1, 3))).toBe("from the first campaign to the latest");
    expect(comparedText(campaigns, withNumbers(0, 2))).toBe("from the first campaign to “set 3” (3 Jan 2026)");
    expect(comparedText(campaigns, withNumbers(1, 3))).toBe("from “set 2” (2 Jan 2026) to the latest");
  });

  it("labels campaigns of one day by their times, of one minute by their numbers", () => {
    const day = (time: string) => `2026-01-0${time}:00Z`;
    expect(whenTexts([day("1T12:00"), day("2T12:00")])).toEqual(["1 Jan 2026", "2 Jan 2026"]);
    expect(new Set(whenTexts([day("1T12:00"), day("1T12:30"), day("2T12:00")])).size).toBe(3);
    expect(whenTexts([day("1T12:00"), day("1T12:00")]).map((label) => label.slice(-3))).toEqual(["(1)", "(2)"]);
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
