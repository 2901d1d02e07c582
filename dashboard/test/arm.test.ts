import { expect, it } from "vitest";
import type { MeasurementSet, RunResult } from "../src/api/types";
import { shownOf } from "../src/features/run/arm";
import type { Chosen } from "../src/features/run/chosen";

const set = { observations: [{ label: "a" }, { label: "b" }] } as MeasurementSet;
const residual = (observation: string, length: number) => ({
  observation,
  deflection: [length, 0, 0],
  residual: [0, 0, 0],
});
const result = {
  residuals: [residual("a", 1e-3), residual("b", 3e-3)],
  joints: [
    { name: "seen", compliance: 1e-6 },
    { name: "unseen", compliance: null },
  ],
  contributions: [
    { joint: "seen", by_observation: [1e-3, -3e-3] },
    { joint: "unseen", by_observation: [0, 0] },
    { joint: "early", by_observation: [-5e-3, 2e-3] },
  ],
} as unknown as RunResult;
const NONE: Chosen = { joint: null, at: null };

it("shows the configuration that deflects most, or the one that is asked for", () => {
  expect(shownOf(set, result, NONE)?.observation.label).toBe("b");
  expect(shownOf(set, result, { ...NONE, at: "a" })?.deflection).toBe(1e-3);
  expect(shownOf(set, result, { ...NONE, at: "elsewhere" })?.observation.label).toBe("b");
});

it("gives no contribution to a joint that the readings do not show", () => {
  expect(shownOf(set, result, NONE)?.parts).toEqual([3e-3, null]);
});

it("shows no arm where no target was read", () => {
  expect(shownOf(set, { ...result, residuals: [] }, NONE)).toBeNull();
});

it("turns to the configuration to which the chosen joint contributes most, unless one was chosen", () => {
  expect(shownOf(set, result, { joint: "early", at: null })?.observation.label).toBe("a");
  expect(shownOf(set, result, { joint: "early", at: "b" })?.observation.label).toBe("b");
});

it("stays where the deflection is greatest for a joint that contributes nothing", () => {
  expect(shownOf(set, result, { joint: "unseen", at: null })?.observation.label).toBe("b");
  expect(shownOf(set, result, { joint: "of another robot", at: null })?.observation.label).toBe("b");
});
