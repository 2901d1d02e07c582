// @vitest-environment happy-dom
import { expect, it } from "vitest";
import type { DeflectionResult } from "../../src/api/types";
import { Answer } from "../../src/views/use";
import { drawn } from "./drawn";

const budget = {
  included: ["readings"],
  contributions: {},
  standard_uncertainty: 23e-6,
  coverage_factor: 1.96,
  expanded_uncertainty: 45e-6,
  expanded_with_model_error: 53e-6,
};
const ends: [number, number] = [-1e-5, 1e-5];
const predicted: DeflectionResult["cases"][number] = {
  label: "1",
  displacement: [0, 0, -1.2e-3],
  rotation: [0, 0, 0],
  readings_only: [ends, ends, ends],
  rotation_interval: [ends, ends, ends],
  with_model_error: { displacement: [ends, ends, ends], radius: 28e-6, load_ratio: 0.5, leverage_ratio: 0.6 },
  compliance: null,
  budget,
  remarks: [],
};

const facts = async (changes: Partial<typeof predicted>) => {
  const result = {
    assessment: {
      verdict: "use" as const,
      reasons: [],
      joints_identified: 6,
      joint_count: 6,
      headline: null,
      notes: [],
    },
    confidence: 0.95,
    joint_kinds: {},
    model_error_postures: 19,
    remarks: [],
    cases: [{ ...predicted, ...changes }],
  };
  const root = await drawn(<Answer answer={result} />);
  const rows = [...root.querySelectorAll("dl.facts > div")].map((row) => [
    row.querySelector("dt")?.textContent ?? "",
    row.querySelector("dd")?.textContent ?? "",
  ]);
  return Object.fromEntries(rows) as Record<string, string>;
};

it("shows U of the budget without and with model error, and not the ball's radius", async () => {
  const shown = await facts({});
  expect(shown["Deflection"]).toBe("1200 µm");
  expect(shown["U, readings only (95\u00a0%, k = 1.96)"]).toBe("± 45 µm");
  expect(shown["U, with model error (95\u00a0%, k = 1.96)"]).toBe("± 53 µm");
  expect(Object.values(shown).join()).not.toContain("28");
  expect(Object.keys(shown)).toContain("Along z, readings only (95\u00a0% interval)");
});

it("claims no model error where it has no bound", async () => {
  const shown = await facts({ with_model_error: null });
  expect(Object.keys(shown).filter((label) => label.startsWith("U,"))).toEqual([
    "U, readings only (95\u00a0%, k = 1.96)",
  ]);
});

it("says that the radius is the model error alone where there is no budget", async () => {
  const shown = await facts({ budget: null });
  expect(shown["Model error alone, radius (95\u00a0%)"]).toBe("28 µm");
});
