import { describe, expect, it } from "vitest";
import { notFinite, understand } from "../src/lib/campaign";

const SET = {
  name: "cell 3",
  units: { length: "mm", angle: "deg", force: "kgf" },
  encoders: "motor",
  noise: { sigma: 0.02 },
  load_point: [0, 0, 120],
  observations: [
    { label: "c01", joints: [0, 180], force: [0, 0, -150], readings: [{ target: "P10" }, { target: "P11" }] },
    { label: "c02", joints: [0, 90], force: [0, 0, -100], readings: [{ target: "P10" }] },
  ],
};

describe("what a file is", () => {
  it("takes a campaign, with a byte order mark too", () => {
    const read = understand(
      `\ufeff${JSON.stringify({ robot: { name: "arm" }, measurement_set: SET, run: { method: "complete_pose" } })}`,
    );
    expect(read).toMatchObject({ robot: { name: "arm" }, robotId: null, run: { method: "complete_pose" } });
  });
  it("takes a bare set, and keeps its robot apart from it", () => {
    const read = understand(JSON.stringify({ ...SET, robot_id: "abc" }));
    expect(read).toMatchObject({ robot: null, robotId: "abc", set: { name: "cell 3" } });
    expect(typeof read === "string" ? {} : read.set).not.toHaveProperty("robot_id");
  });
  it.each([
    ["", "empty"],
    ["nan", "not_json"],
    ["NaN", "not_finite"],
    ["[1]", "not_object"],
    ["{}", "not_a_set"],
    ['{"sweeps": []}', "sweeps"],
  ])("%j is %s", (content, fault) => expect(understand(content)).toBe(fault));
});

describe("what it says", () => {
  it("is in SI, whatever the file's units", () => {
    const read = understand(JSON.stringify(SET));
    if (typeof read === "string") throw new Error(read);
    const { facts } = read;
    expect(facts).toMatchObject({
      observations: 2,
      targets: ["P10", "P11"],
      encoders: "motor",
    });
    expect(facts.forces?.[0]).toBeCloseTo(980.665);
    expect(facts.forces?.[1]).toBeCloseTo(1470.9975);
    expect(facts.sigma).toBeCloseTo(2e-5);
    expect(facts.loadPoint?.[2]).toBeCloseTo(0.12);
    expect(facts.firstJoints?.[1]).toBeCloseTo(Math.PI);
  });
  it("is as stated where a word is no unit", () => {
    const read = understand(JSON.stringify({ ...SET, units: { ...SET.units, length: "millimeter" } }));
    if (typeof read === "string") throw new Error(read);
    const { facts } = read;
    expect(facts).toMatchObject({ units: { length: "millimeter" }, sigma: 0.02, loadPoint: [0, 0, 120] });
    expect(facts.forces?.[0]).toBeCloseTo(980.665);
    expect(facts.firstJoints?.[1]).toBeCloseTo(Math.PI);
  });
  it("says nothing where the file is wrong, and never throws", () => {
    for (const wrong of [
      { observations: [null, 1, {}] },
      { observations: [{ joints: "x", force: [1], readings: {} }], units: "mm", noise: 3, name: 4 },
    ]) {
      const read = understand(JSON.stringify(wrong));
      if (typeof read === "string") throw new Error(read);
      expect(read.facts).toMatchObject({ units: null, forces: null, sigma: null, name: null, targets: [] });
    }
  });
});

describe("a number that is not finite", () => {
  it.each([
    ['{"measurement_set": {"noise": {"sigma": NaN}}}', "NaN in measurement_set.noise.sigma"],
    ['{"a": "NaN", "observations": [{"joints": [0, -Infinity]}]}', "-Infinity in observations[0].joints[1]"],
    ['{"a": "NaN \\" Infinity"}', null],
    ["{NaN", null],
  ])("is named by its field: %s", (content, expected) => {
    expect(notFinite(content)).toBe(expected);
  });
});
