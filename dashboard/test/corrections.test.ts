import { describe, expect, it } from "vitest";
import type { Action, MeasurementSet } from "../src/api/types";
import { corrected, exchangeable } from "../src/lib/corrections";

const action = { kind: "exchange_load_and_target", target: "T1" } as Action;
const set = (flange_targets: MeasurementSet["flange_targets"]): MeasurementSet =>
  ({ observations: [], load_point: [1, 2, 3], flange_targets }) as unknown as MeasurementSet;

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
