import { describe, expect, it } from "vitest";
import type { PlanRequest, PlanResult } from "../src/api/types";
import { readSoFar, toFillIn } from "../src/lib/live";

const READING = { label: "p1", joints: [Math.PI / 2], force: [0, 0, -1000], anchor: null, validation: false, block: 1 };
const REQUEST = { targets: {}, sigma: 2e-5, load_point: null } as unknown as PlanRequest;

describe("the campaign to fill in", () => {
  it("keeps the units and the readings of the campaign so far", () => {
    const base = {
      id: "1",
      warnings: [],
      robot_id: "r",
      units: { length: "mm", angle: "deg", force: "kN" },
      observations: [{ label: "c1", readings: [{ target: "T", unloaded: [1, 2, 3], loaded: [1, 2, 3] }] }],
    };
    const document = toFillIn(REQUEST, [READING] as PlanResult["readings"], "r", base as never);
    expect(document).not.toHaveProperty("id");
    const [before, planned] = document["observations"] as Record<string, unknown>[];
    expect(before).toBe(base.observations[0]);
    expect(planned?.["joints"]).toEqual([90]);
    expect(planned?.["force"]).toEqual([0, 0, -1]);
    expect(readSoFar(document)?.labels).toEqual(["c1"]);
  });
  it("has nothing to read while all is null", () => {
    expect(
      readSoFar(toFillIn({ ...REQUEST, targets: { P: [0, 0, 0] } }, [READING] as PlanResult["readings"], "r", null)),
    ).toBeNull();
  });
});
