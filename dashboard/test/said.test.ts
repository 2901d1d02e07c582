import { describe, expect, it } from "vitest";
import type { Finding } from "../src/api/types";
import { fieldName, firstSentence, isUnseen, onPage, roundedP, placeName, sentence, unsaid } from "../src/lib/said";

const warning = (code: string, message: string) => ({ code, message, remedy: "", where: null }) as Finding;
const reason = (code: string, message: string) => ({ code, message }) as Finding;

describe("a note", () => {
  it.each([
    ["The readings raise a doubt that the load point is known to ±0.1 mm (p = 0.03).", true],
    ["If N and kgf were confused, every stiffness would be wrong, and no reading would show it.", true],
    ["Each posture was read only once without load, so a deflection that remains is not detected.", true],
    ["The joint angles and the geometry of robot, frames and targets cannot be checked.", true],
    ["The load point is assumed to be known to ±10 mm.", false],
    ["After unloading, the targets return to within 3 µm; 2 % of the deflection remains (u = 1 %).", false],
  ])("%s: unseen %s", (note, unseen) => expect(isUnseen(note)).toBe(unseen));
});

describe("what a reason says", () => {
  it("is not said again, nor are others of its kind", () => {
    const warnings = [
      warning("target_moved", "P1 moved"),
      warning("target_moved", "P2 moved"),
      warning("zero_load", "none"),
    ];
    const reasons = [reason("target_moved", "P1 moved (and 1 more of this kind)")];
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
  expect(onPage("check the id; list the existing ids with GET /v1/jobs")).toBe("check the id");
  expect(onPage("state it (on the page: Advanced)")).toBe("state it (Identify: Advanced)");
});

it("names fields as a person does who sends no requests, and rounds small probabilities", () => {
  expect(fieldName("noise.load_point")).toBe("uncertainty of the load point");
  expect(fieldName("points.csv")).toBeUndefined();
  expect(roundedP("the model explains more (F test, p = 2e-80); p = 0.02")).toBe(
    "the model explains more (F test, p < 0.001); p = 0.02",
  );
});

describe("a message in a line", () => {
  it("is its first sentence, not a number or a name with a point", () => {
    expect(firstSentence("Something bends (F test, p < 0.001). The model predicts 145 µm")).toEqual([
      "Something bends (F test, p < 0.001).",
      "The model predicts 145 µm",
    ]);
    expect(firstSentence("2.25 times sigma; see cell.3 A")).toEqual(["2.25 times sigma; see cell.3 A", ""]);
  });
});
