import { describe, expect, it } from "vitest";
import type { JointResult } from "../src/api/types";
import { estimateText } from "../src/lib/estimate";
import { shownStiffness, postureText, isRefuted, lowerLimit, verdictOf, withUnit } from "../src/lib/stiffness";

/** A joint with what the page looks at. */
const joint = (part: Partial<JointResult>): JointResult =>
  ({
    name: "j",
    status: "identified",
    compliance: 1e-6,
    stiffness: 1e6,
    standard_uncertainty: 1e-8,
    compliance_interval: null,
    stiffness_interval: [0.98e6, 1.02e6],
    stiffness_at_least: null,
    prior_to_data: null,
    reason: null,
    ...part,
  }) as JointResult;

describe("verdicts", () => {
  it.each([
    [joint({}), "firm"],
    [joint({ stiffness_interval: [0.9e6, 1.1e6] }), "fair"],
    [joint({ stiffness_interval: [0.5e6, 5e6] }), "rough"],
    [joint({ stiffness_interval: [0.5e6, null] }), "lower_limit"],
    [joint({ stiffness_interval: null }), "unrated"],
    [joint({ stiffness_interval: null, standard_uncertainty: 6e-7 }), "vague"],
    [joint({ status: "at_bound", compliance: 0, stiffness: null, stiffness_interval: [2e6, null] }), "lower_limit"],
    [joint({ compliance: -1e-6, stiffness: -1e6, stiffness_interval: null }), "negative"],
    [joint({ status: "not_observable", compliance: null, stiffness: null, stiffness_interval: null }), "unobservable"],
  ])("%# is %s", (given, verdict) => expect(verdictOf(given as JointResult)).toBe(verdict));
  it("gives no lower limit of a result that is not to be used", () => {
    const rigid = { status: "at_bound", compliance: 0, stiffness: null, stiffness_interval: [2e6, null] } as const;
    const open = { stiffness_interval: [0.5e6, null] } as const;
    for (const part of [rigid, open]) {
      const shown = (verdict: JointResult["verdict"]) =>
        shownStiffness(joint({ ...part, stiffness_at_least: 3e6, verdict } as Partial<JointResult>), "MNm");
      expect(shown("do_not_use")).toEqual({ value: null, limit: null, interval: null, unusable: true, relative: null });
      expect(shown("use_with_care").limit).toBe("> 3.0");
    }
    expect(shownStiffness(joint({ verdict: "do_not_use" }), "MNm").interval).not.toBeNull();
  });
  it("does not refute a joint that no reading shows", () => {
    const unseen = { status: "not_observable", stiffness: null, verdict: "do_not_use" } as const;
    expect(isRefuted(joint(unseen as Partial<JointResult>))).toBe(false);
    expect(isRefuted(joint({ ...unseen, status: "at_bound" } as Partial<JointResult>))).toBe(true);
  });
  it("prefers the one-sided limit to the lower end of the interval", () => {
    expect([lowerLimit(joint({ stiffness_at_least: 3e6 })), lowerLimit(joint({}))]).toEqual([3e6, 0.98e6]);
  });
});

describe("stiffness in the unit that was chosen", () => {
  it("has its interval, both with the digits that the interval allows", () => {
    const rounded = joint({ stiffness: 1_234_567, stiffness_interval: [1_214_567, 1_254_567] });
    expect(shownStiffness(rounded, "MNm")).toMatchObject({ value: "1.235", interval: "1.215 … 1.255" });
    expect(estimateText(shownStiffness(rounded, "MNm"))).toBe("1.235 (1.215\u00a0…\u00a01.255)");
  });
  it("says that there is no interval, and shows no standard uncertainty instead", () =>
    expect(shownStiffness(joint({ stiffness_interval: null }), "MNm")).toMatchObject({
      value: "1.00",
      interval: "no interval",
    }));
  it("gives the range outside of which the stiffness is, where the compliance may be negative", () => {
    const free = joint({ stiffness_interval: null, compliance_interval: [-1e-6, 2e-6] });
    expect(shownStiffness(free, "MNm").interval).toBe("not −1.00 … 0.50");
  });
  it("puts the unit of a prismatic joint beside its number", () => {
    const slide = joint({ kind: "prismatic", stiffness: 20_100_000, stiffness_interval: [20_000_000, 20_200_000] });
    expect(shownStiffness(slide, "MNm").value).toBe("20.100\u00a0N/µm");
    expect(shownStiffness(slide, "NmArcmin").value).toBe("20.100\u00a0N/µm");
    expect(withUnit("80", "10⁶ N·m/rad")).toBe("80 · 10⁶ N·m/rad");
    expect(postureText([Math.PI / 2, 0.25], ["revolute", "prismatic"], 0)).toBe("90°, 250\u00a0mm");
  });
  it("gives only a limit where there is no value, rounded so that it stays a limit", () => {
    const rigid = { status: "at_bound", compliance: 0, stiffness: null, stiffness_interval: [2.19e6, null] } as const;
    const shown = shownStiffness(joint(rigid as Partial<JointResult>), "MNm");
    expect(estimateText(shown)).toBe("> 2.1");
  });
});

describe("units; an interval that lies to one side has both of its ends", () => {
  // 1e6 N·m/rad: 290.89 N·m/arcmin
  const k = joint({ stiffness: 1e6, compliance: 1e-6, stiffness_interval: [0.8e6, 2e6] });
  it.each([["NmArcmin", "291", "233 … 582"]] as const)("%s", (unit, value, interval) =>
    expect(shownStiffness(k, unit)).toMatchObject({ value, interval }),
  );
});
