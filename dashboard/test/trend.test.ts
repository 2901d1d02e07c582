import { describe, expect, it } from "vitest";
import type { Trend, TrendJoint } from "../src/api/types";
import { changeText, comparedText, firstCompared, placesOf, ticksOf, whenTexts } from "../src/features/trend/trend";

const joint = (part: Partial<TrendJoint>): TrendJoint => ({
  name: "joint_1",
  kind: "revolute",
  points: [],
  change: null,
  p_value: null,
  unchanged: null,
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

  it("names the campaigns that a test compares where they are not the first and the latest", () => {
    const at = (day: number) => ({ name: `set ${day}`, measurement_set_id: `${day}`, at: `2026-01-0${day}T12:00:00Z` });
    const campaigns = [1, 2, 3, 4].map(at) as Trend["campaigns"];
    const withNumbers = (...known: number[]) =>
      joint({
        points: campaigns.map((_, i) => ({ stiffness: 1, interval: null, reason: known.includes(i) ? null : "wide" })),
      });
    expect(comparedText({ campaigns, reference_set_id: null }, withNumbers(0, 1, 3))).toBe(
      "from the first campaign to the latest",
    );
    expect(comparedText({ campaigns, reference_set_id: null }, withNumbers(0, 2))).toBe(
      "from the first campaign to “set 3” (3 Jan 2026)",
    );
    expect(comparedText({ campaigns, reference_set_id: null }, withNumbers(1, 3))).toBe(
      "from “set 2” (2 Jan 2026) to the latest",
    );
  });

  it("labels campaigns of one day by their times, of one minute by their numbers", () => {
    const day = (time: string) => `2026-01-0${time}:00Z`;
    expect(whenTexts([day("1T12:00"), day("2T12:00")])).toEqual(["1 Jan 2026", "2 Jan 2026"]);
    expect(new Set(whenTexts([day("1T12:00"), day("1T12:30"), day("2T12:00")])).size).toBe(3);
    expect(whenTexts([day("1T12:00"), day("1T12:00")]).map((label) => label.slice(-3))).toEqual(["(1)", "(2)"]);
  });

  it("compares with the campaign that the user chose, or the first after it with a number", () => {
    const campaigns = ["a", "b", "c"].map((id) => ({ measurement_set_id: id })) as Trend["campaigns"];
    const point = (reason: string | null) => ({ stiffness: 1, interval: null, reason });
    const known = joint({ points: [point(null), point("wide"), point(null)] });
    expect(firstCompared({ campaigns, reference_set_id: null }, known)).toBe(0);
    expect(firstCompared({ campaigns, reference_set_id: "b" }, known)).toBe(2);
  });

  it("has one axis of time on which no campaign hides another", () => {
    const day = 24 * 3600e3;
    const { places, timeAt } = placesOf([0, 1000, 10 * day, 100 * day], [50 * day], 0, 500);
    expect(places.map(Math.round)).toEqual([0, 16, 50, 500]);
    expect(timeAt?.(50 * day)).toBe(250);
    expect(placesOf([5, 5, 5], [], 0, 300)).toEqual({ places: [50, 150, 250], timeAt: null });
    const late = placesOf([0, 10 * day, 10 * day + 1, 10 * day + 2], [], 0, 100).places;
    expect(late).toEqual([0, 68, 84, 100]);
  });

  it("has ticks at round days, months or years", () => {
    const at = (time: string) => Date.parse(`${time}T12:00`);
    const labels = (from: string, to: string) => ticksOf([at(from), at(to)], [], 6).map(({ label }) => label);
    expect(labels("2026-01-10", "2026-05-20")).toEqual(["Feb 2026", "Mar 2026", "Apr 2026", "May 2026"]);
    expect(labels("2020-03-01", "2026-05-20").every((label) => label.startsWith("Jan"))).toBe(true);
    expect(labels("2026-03-01", "2026-03-05")).toEqual(["2 Mar", "3 Mar", "4 Mar", "5 Mar"]);
  });
});
