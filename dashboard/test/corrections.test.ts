import { describe, expect, it } from "vitest";
import type { Action, MeasurementSet } from "../src/api/types";
import { corrected, exchangeable } from "../src/lib/corrections";

const action = { kind: "exchange_load_and_target", target: "T1" } as Action;
const set = (flange_targets: MeasurementSet["flange_targets"]): MeasurementSet =>
  ({ observations: [], load_point: [1, 2, 3], flange_targets }) as unknown as MeasurementSet;

describe("corrections of loads, units and readings", () => {
  const measured = {
    units: { length: "mm", angle: "rad", force: "kN" },
    load_point: [1, 2, 3],
    observations: [
      { load_point: null, force: [0, 0, -1], readings: [{ unloaded: [1, 1, 1], loaded: [2, 2, 2], deflection: null }] },
      { load_point: [4, 5, 6], force: [1, 0, 0], readings: [{ unloaded: null, loaded: null, deflection: [1, -2, 0] }] },
    ],
  } as unknown as MeasurementSet;
  const by = (one: object) => corrected(measured, one as Action, []);

  it("adds metres to millimetres and newtons to kilonewtons", () => {
    const moved = by({ kind: "correct_load_point", correction: [0.01, 0, -0.001] });
    expect(moved.load_point).toEqual([11, 2, 2]);
    expect(moved.observations.map((one) => one.load_point)).toEqual([null, [14, 5, 5]]);
    const pulled = by({ kind: "correct_force", correction: [0, 0, -100] });
    expect(pulled.observations.map((one) => one.force)).toEqual([
      [0, 0, -1.1],
      [1, 0, -0.1],
    ]);
  });
  it("declares another unit and exchanges readings", () => {
    expect(by({ kind: "convert_units", unit: "m" }).units).toEqual({ length: "m", angle: "rad", force: "kN" });
    expect(by({ kind: "convert_units", unit: "deg" }).units.angle).toBe("deg");
    const [first, second] = by({ kind: "exchange_readings" }).observations;
    expect(first?.readings[0]).toMatchObject({ unloaded: [2, 2, 2], loaded: [1, 1, 1] });
    expect(second?.readings[0]?.deflection).toEqual([-1, 2, 0]);
  });
});

describe("exchanging load point and target", () => {
  it("changes places where the set states both", () => {
    const stated = set({ T1: [4, 5, 6] });
    expect(exchangeable(stated, action)).toBe(true);
    expect(corrected(stated, action, [])).toMatchObject({ load_point: [4, 5, 6], flange_targets: { T1: [1, 2, 3] } });
  });
  it("is not offered where the target's place is not stated", () => {
    expect(exchangeable(set({ T2: [4, 5, 6] }), action)).toBe(false);
    expect(exchangeable(set({}), { ...action, kind: "omit_noise" })).toBe(true);
  });
});
