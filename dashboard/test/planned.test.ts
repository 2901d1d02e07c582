import { describe, expect, it } from "vitest";
import type { PlanRequest, PlanResult } from "../src/api/types";
import { type Asked, optionsOf, point, readSoFar, targetsOf, toFillIn } from "../src/lib/planned";

const ASKED: Asked = {
  targets: "P1 100 0 50",
  loadPoint: "",
  station: "",
  sigma: "20",
  kind: "dead_weight",
  force: "900",
  anchors: "",
  floor: "",
  readings: "12",
  joints: [],
};

describe("what is asked for", () => {
  it("is read in mm and sent in m", () => {
    expect(point("100, -20; 5")).toEqual([0.1, -0.02, 0.005]);
    expect(point("100 -20")).toBeNull();
    expect(point("100 x 3")).toBeNull();
    expect(targetsOf("P1 1 2 3\n\nP2 4 5 6")).toEqual({ P1: [0.001, 0.002, 0.003], P2: [0.004, 0.005, 0.006] });
    expect(targetsOf("P1 1 2")).toBe("P1 1 2");
  });
  it("leaves out what is empty", () => {
    expect(optionsOf({ ...ASKED, targets: "", force: "", sigma: "" })).toEqual({ readings: 12 });
  });
  it("has a tracker where it has a station, and anchors where it has a cable", () => {
    const found = optionsOf({ ...ASKED, station: "4000 0 1500", kind: "cable", anchors: "3000 0 0" });
    const uncertainty = { constant: 20e-6, per_distance: 0 };
    expect(found).toMatchObject({
      tracker: { station: [4, 0, 1.5], range: uncertainty, transverse: uncertainty },
      load: { kind: "cable", force: 900, anchors: [[3, 0, 0]] },
    });
    expect(found).not.toHaveProperty("sigma");
    expect(optionsOf({ ...ASKED, kind: "cable", anchors: "3000 0" })).toBe("3000 0");
  });
});

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
