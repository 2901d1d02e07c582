import { describe, expect, it } from "vitest";
import {
  equipmentOf,
  filledRecords,
  freeLabel,
  observationOf,
  standTyped,
  unread,
  exchanged,
  givenWay,
  isComplete,
  type Rows,
  simulatedRows,
  tracked,
  SIMULATED_STIFFNESSES,
} from "../src/features/measure/live";
import { inUnits } from "../src/lib/observation";
import { keptIn } from "../src/features/measure/live_state";
import type { LiveState, MeasurementSet, Observation, Posture, Units } from "../src/api/types";

const MM = { length: "mm", angle: "deg", force: "N" } as Units;
const SI = { length: "m", angle: "rad", force: "N" } as Units;
const BLANK = { P1: { unloaded: "", loaded: "" }, P2: { unloaded: "", loaded: "" } };

describe("a reading as it is typed", () => {
  it("says which target lacks numbers, and leaves out those that are blank", () => {
    expect(unread(BLANK, false)).toBe("P1");
    const half = { ...BLANK, P2: { unloaded: "1 2 3", loaded: "" } };
    expect(unread(half, false)).toBe("P2");
    expect(unread(half, true)).toBeNull();
    const made = observationOf("m01", { joints: [Math.PI / 2], force: [0, 0, -9], anchor: null }, half, MM, [], true);
    expect(made).toEqual({
      label: "m01",
      joints: [90],
      force: [0, 0, -9],
      readings: [{ target: "P2", unloaded: [1, 2, 3] }],
    });
  });

  it("takes a third position, after unloading", () => {
    const row = { P1: { unloaded: "1 2 3", loaded: "1 2 4", unloaded_after: "1 2" } };
    expect(unread(row, false)).toBe("P1");
    row.P1.unloaded_after = "1 2 3.5";
    expect(unread(row, false)).toBeNull();
    const { readings } = observationOf("m01", { joints: [0], force: [0, 0, -9], anchor: null }, row, MM, [], false);
    expect(readings).toEqual([{ target: "P1", unloaded: [1, 2, 3], loaded: [1, 2, 4], unloaded_after: [1, 2, 3.5] }]);
    const back = inUnits({ joints: [], force: [0, 0, 0], readings } as unknown as Observation, MM, SI, []);
    expect(back.readings[0]?.unloaded_after).toEqual([0.001, 0.002, 0.0035]);
  });

  it("takes postures and labels", () => {
    expect(standTyped("180 -90", "0, 0, -9", ["revolute", "revolute"])?.joints).toEqual([Math.PI, -Math.PI / 2]);
    expect(standTyped("180", "0 0 -9", ["revolute", "revolute"])).toBeNull();
    expect(freeLabel("m01", new Set(["m01", "m02"]))).toBe("m03");
    expect(freeLabel("m05", new Set(["m01"]))).toBe("m05");
  });

  it("leaves out the rows of a plan's list that are still blank", () => {
    const head = "label,joint_1 [deg],P1 unloaded x [mm],P1 loaded x [mm],verdict";
    expect(filledRecords([head, "p1,1,2,3.5,use", "p2,1,,,use", ""].join("\n"))).toEqual([
      { label: "p1", "J1 [deg]": 1, "P1 unloaded x [mm]": 2, "P1 loaded x [mm]": 3.5 },
    ]);
    expect(filledRecords("name,x\na,1")).toBeNull();
  });

  it("brings a file's units to those of the set", () => {
    const read = {
      label: "c01",
      joints: [90],
      force: [0, 0, -9],
      readings: [{ target: "P1", unloaded: [1000, 0, 0], loaded: [1000, 0, -1] }],
    } as unknown as Observation;
    const { joints, readings } = inUnits(read, MM, SI, ["revolute"]);
    expect(joints[0]).toBeCloseTo(Math.PI / 2, 12);
    expect(readings[0]).toMatchObject({ unloaded: [1, 0, 0], loaded: [1, 0, -0.001] });
  });
});

describe("the simulated arm", () => {
  const posture = {
    joint_origins: [[0, 0, 1]],
    joint_axes: [[0, 1, 0]],
    joint_kinds: ["revolute"],
    flange_origin: [2, 0, 1],
    flange_axes: [
      [1, 0, 0],
      [0, 1, 0],
      [0, 0, 1],
    ],
  } as unknown as Posture;

  it("finds targets on the flange that a set does not state", () => {
    const [joints, force] = [[0], [0, 0, -9]];
    const readings = [{ target: "P1", unloaded: [2100, -50, 1200] }];
    const observations = [{ label: "c01", joints, force, readings }];
    const set = { units: MM, observations, geometry_targets: {} } as unknown as MeasurementSet;
    const turned = {
      ...posture,
      flange_axes: [posture.flange_axes[1], posture.flange_axes[2], posture.flange_axes[0]],
    };
    expect(equipmentOf(set, turned as Posture)["targets"]).toEqual({ P1: [-0.05, 0.2, 0.1] });
  });

  it("balances a weight on a lever exactly: k θ = F L cos θ", () => {
    const [angle = 0] = givenWay(posture, [1e5], [0, 0, 0], [0, 0, -1000]);
    expect(1e5 * angle).toBeCloseTo(2000 * Math.cos(angle), 6);
    expect(angle).toBeGreaterThan(0.0199);
  });

  it("reads a weight's deflection but for its noise, and exchanges targets when asked", () => {
    const of = { targets: { P1: [0, 0, 0], P2: [0, 0.1, 0] } as never, loadPoint: [0, 0, 0] as never };
    const rows = simulatedRows(posture, [0, 0, -1000], of);
    const [unloaded, loaded] = [rows["P1"]?.unloaded, rows["P1"]?.loaded].map((typed) => typed?.split(" ").map(Number));
    const theta = 2000 / (SIMULATED_STIFFNESSES[0] ?? 0);
    expect((loaded?.[2] ?? 0) - (unloaded?.[2] ?? 0)).toBeGreaterThan(-2000 * theta - 0.3);
    expect((loaded?.[2] ?? 0) - (unloaded?.[2] ?? 0)).toBeLessThan(-2000 * theta + 0.3);
    expect(exchanged(rows)["P1"]).toEqual(rows["P2"]);
  });
});

describe("a mistake that was kept", () => {
  const one = (label: string, state = "counts", doubtful = false) => ({ label, state, doubtful });
  const mistake = (observation: string, message = "exchanged") => ({ weight: "do_not_use", observation, message });
  const state = (readings: unknown[]) =>
    ({
      readings,
      assessment: { reasons: [mistake("m03", "exchanged (and 1 more of this kind)")] },
      warnings: [mistake("m03"), mistake("m05")],
    }) as unknown as LiveState;

  it("is found by its data, each of several", () => {
    const kept = keptIn(state([one("m01"), one("m02", "counts", true), one("m03", "counts", true), one("m05")]));
    expect(kept).toEqual({ kept: ["m02", "m03", "m05"], named: ["m03", "m05"] });
  });
  it("is none that is withdrawn, nor asked about yet", () => {
    expect(keptIn(state([one("m03", "withdrawn", true), one("m05")])).named).toEqual(["m05"]);
    const asked = keptIn(state([one("m03", "counts", true), one("m04"), one("m05", "doubtful", true)]));
    expect(asked).toEqual({ kept: ["m03"], named: [] });
  });
});

describe("a tracker that writes into the form", () => {
  const rows: Rows = { P1: { unloaded: "1 2 3", loaded: "" }, P2: { unloaded: "4 5 6", loaded: "" } };

  it("fills its column in mm, to 0.1 µm, and leaves the other one", () => {
    const filled = tracked(rows, "loaded", { P1: [1.00000004, -0.5, 0.0123456] }, new Set());
    expect(filled).toEqual({ P1: { unloaded: "1 2 3", loaded: "1000.0000 -500.0000 12.3456" }, P2: rows["P2"] });
    expect(isComplete(filled, "unloaded")).toBe(true);
    expect(isComplete(filled, "loaded")).toBe(false);
  });

  it("takes back what it said before trouble, and nothing that was typed", () => {
    const typed: Rows = { P1: { unloaded: "1 2 3", loaded: "7 8 9" }, P2: { unloaded: "4 5 6", loaded: "7 8 9" } };
    const left = tracked(typed, "loaded", {}, new Set(["P1"]));
    expect(left["P1"]?.loaded).toBe("");
    expect(left["P2"]).toBe(typed["P2"]);
  });
});
