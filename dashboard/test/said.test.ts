import { describe, expect, it } from "vitest";
import type { Finding } from "../src/api/types";
import { inShownUnits, placeName, sentence, unsaid } from "../src/lib/said";

const warning = (code: string, message: string) => ({ code, message, remedy: "", where: null }) as Finding;
const reason = (code: string, message: string) => ({ code, message }) as Finding;

describe("what a reason says", () => {
  it("is not said again, nor are others of its kind", () => {
    const warnings = [
      warning("target_moved", "P1 moved"),
      warning("target_moved", "P2 moved"),
      warning("zero_load", "none"),
    ];
    const reasons = [reason("gross_error", "P1 moved (and 1 more of this kind)")];
    expect(unsaid(warnings, reasons).map(({ code }) => code)).toEqual(["zero_load"]);
  });
  it("covers what it says better", () => {
    const warnings = [warning("deflections_unexplained", "46 %"), warning("residual_outlier", "c01")];
    expect(unsaid(warnings, [reason("deflection_unexplained", "46 %, usual is 80 %")])).toEqual([]);
    expect(unsaid(warnings, [])).toEqual(warnings);
  });
});

it("begins sentences with a capital, names and labels with what they are", () => {
  expect(sentence("the residuals are large")).toBe("The residuals are large");
  expect(sentence("joint_2 is stiff")).toBe("joint_2 is stiff");
  expect(placeName("observations[4] 'c05'")).toBe("c05");
  expect(placeName("first.observations[4] 'c05'")).toBe("c05 (first)");
  expect(placeName("joint_2")).toBe("joint_2");
});

describe("units of the service's sentences", () => {
  it("become those of the page", () => {
    expect(inShownUnits("the load point is 1.2 m from the flange")).toBe("the load point is 1200 mm from the flange");
    expect(inShownUnits("the limits 0.5 and -1e-1 m leave no range")).toBe("the limits 500 and -100 mm leave no range");
    expect(inShownUnits("the largest angle is 6.28319 rad, more")).toBe("the largest angle is 360°, more");
    expect(inShownUnits("give it in metres, at 900 N")).toBe("give it in mm, at 900 N");
  });
  it("leaves other units and words alone", () => {
    for (const words of ["1.5 m/s", "3 mrad", "12 mm", "2 measured", "0.3 rad/(N·m)"])
      expect(inShownUnits(words)).toBe(words);
  });
});
