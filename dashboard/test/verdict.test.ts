import { describe, expect, it } from "vitest";
import type { JointResult } from "../src/api/types";
import {
  shownStiffness,
  postureText,
  isRefuted,
  lowerLimit,
  stiffnessUncertainty,
  verdictOf,
  withUnit,
} from "../src/lib/stiffness";

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
  it("u(k) = k² u(c)", () => expect(stiffnessUncertainty(joint({}))).toBeCloseTo(1e4));
  it("gives no lower limit of a result that is not to be used", () => {
    const rigid = { status: "at_bound", compliance: 0, stiffness: null, stiffness_interval: [2e6, null] } as const;
    const open = { stiffness_interval: [0.5e6, null] } as const;
    for (const part of [rigid, open]) {
      const shown = (verdict: JointResult["verdict"]) =>
        shownStiffness(joint({ ...part, stiffness_at_least: 3e6, verdict } as Partial<JointResult>), "MNm");
      expect(shown("do_not_use")).toMatchObject({ limit: null, interval: null });
      expect(shown("use_with_care").limit).toBe("≥ 3.0");
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
  it("shows the digits of the uncertainty", () => {
    const rounded = joint({ stiffness: 1_234_567, stiffness_interval: [1_214_567, 1_254_567] });
    expect(shownStiffness(rounded, "MNm")).toMatchObject({
      value: "1.235",
      uncertainty: "±\u00a00.020",
    });
    expect(shownStiffness(rounded, "Nm")).toMatchObject({
      value: "1\u202f235\u202f000",
      uncertainty: "±\u00a020\u202f000",
    });
  });
  it("shows the standard uncertainty, by its letter, where there is no interval", () =>
    expect(shownStiffness(joint({ stiffness_interval: null }), "MNm").uncertainty).toBe("u\u00a00.010"));
  it("puts the unit of a prismatic joint beside its number", () => {
    const slide = joint({ kind: "prismatic", stiffness: 20_100_000, standard_uncertainty: 1e-9 });
    expect(shownStiffness(slide, "MNm").value).toBe("20.10\u00a0N/µm");
    expect(shownStiffness(slide, "kNmDeg").value).toBe("20.10\u00a0N/µm");
    expect(shownStiffness(slide, "compliance").value).toContain("\u00a0µm/N");
    expect(withUnit("80", "10⁶ N·m/rad")).toBe("80 · 10⁶ N·m/rad");
    expect(postureText([Math.PI / 2, 0.25], ["revolute", "prismatic"], 0)).toBe("90°, 250\u00a0mm");
  });
  it("gives only a limit where there is no value", () => {
    const shown = shownStiffness(
      joint({ status: "at_bound", compliance: 0, stiffness: null, stiffness_interval: [2e6, null] }),
      "MNm",
    );
    expect(shown).toMatchObject({
      value: null,
      uncertainty: null,
      limit: "≥ 2.0",
      interval: { low: "2.0", high: null },
    });
  });
});

describe("units; of an interval that lies to one side, ± would say a wrong end", () => {
  // 1e6 N·m/rad: 17.453 kN·m/°, 290.89 N·m/arcmin, 1 µrad/(N·m)
  const k = joint({ stiffness: 1e6, compliance: 1e-6, standard_uncertainty: 1e-8, stiffness_interval: [0.8e6, 2e6] });
  it.each([
    ["kNmDeg", "17.45", "u\u00a00.17", "13.96", "34.91"],
    ["NmArcmin", "290.9", "u\u00a02.9", "232.7", "581.8"],
    ["compliance", "1.000", "u\u00a00.010", "0.500", "1.250"],
  ] as const)("%s", (unit, value, uncertainty, low, high) =>
    expect(shownStiffness(k, unit)).toMatchObject({ value, uncertainty, interval: { low, high } }),
  );
  it("a compliance without a lower end goes down to zero", () => {
    const open = joint({ stiffness_interval: [0.5e6, null] });
    expect(shownStiffness(open, "compliance")).toMatchObject({ interval: { low: "0", high: "2.0" }, limit: "≤ 2.0" });
  });
});
