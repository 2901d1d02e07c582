import { describe, expect, it } from "vitest";
import type { Plan } from "../src/api/types";
import { readSoFar, toFillIn } from "../src/features/measure/live";

const READING = {
  label: "p1",
  joints: [Math.PI / 2, 0.25],
  force: [0, 0, -1000],
  anchor: null,
  validation: false,
  block: 1,
};
const ROBOT = { id: "r", joints: [{ kind: "revolute" }, { kind: "prismatic" }] } as never;
const plan = (targets: object): Plan =>
  ({ request: { sigma: 2e-5 }, result: { readings: [READING], targets, load_point: [0, 0, 0.1] } }) as never;

describe("the campaign to fill in", () => {
  it("keeps the units and the readings of the campaign so far", () => {
    const base = {
      id: "1",
      warnings: [],
      robot_id: "r",
      units: { length: "mm", angle: "deg", force: "kN" },
      observations: [{ label: "c1", readings: [{ target: "T", unloaded: [1, 2, 3], loaded: [1, 2, 3] }] }],
    };
    const document = toFillIn(plan({ T: [0, 0, 0] }), ROBOT, base as never);
    expect(document).not.toHaveProperty("id");
    const [before, planned] = document["observations"] as Record<string, unknown>[];
    expect(before).toBe(base.observations[0]);
    expect(planned?.["joints"]).toEqual([90, 250]);
    expect(planned?.["readings"]).toMatchObject([{ target: "T", unloaded: null, loaded: null }]);
    expect(planned?.["force"]).toEqual([0, 0, -1]);
    expect(readSoFar(document)?.labels).toEqual(["c1"]);
  });
  it("has nothing to read while all is null", () => {
    const document = toFillIn(plan({ P: [0, 0, 0] }), ROBOT, null);
    expect(document).toMatchObject({ load_point: [0, 0, 0.1], noise: { sigma: 2e-5 } });
    expect(readSoFar(document)).toBeNull();
  });
});
