// @vitest-environment happy-dom
import { expect, it } from "vitest";
import type { DeflectionResult } from "../../src/api/types";
import { Answer, withPulled } from "../../src/features/use/forms";
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
      questions: [],
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

it("has one interval for each number, with the model error where it is known", async () => {
  const shown = await facts({});
  expect(shown["Deflection"]).toBe("1200 µm (1147\u00a0…\u00a01253)");
  expect(shown["Along z"]).toMatch(/\(−10\u00a0…\u00a010\)$/);
  expect(shown["In brackets"]).toBe("95\u00a0% interval, with model error");
  expect(Object.values(shown).join()).not.toMatch(/±|U,|28/);
});

it("says where the model error is unknown", async () => {
  const shown = await facts({ with_model_error: null });
  expect(shown["Deflection"]).toBe("1200 µm (1155\u00a0…\u00a01245)");
  expect(shown["In brackets"]).toBe("95\u00a0% interval, readings only: the model error is unknown");
});

it("has the ball of the model error as interval where there is no budget", async () => {
  const shown = await facts({ budget: null });
  expect(shown["Deflection"]).toBe("1200 µm (1172\u00a0…\u00a01228)");
});

it("leaves out a late answer to a pull at another posture", () => {
  const question = { joints: [0, 10], force: [0, 0, -100] as const, load_point: [0, 0, 0] as const };
  const place = JSON.stringify({ joints: question.joints, load_point: question.load_point });
  const answer = { cases: [predicted] } as unknown as DeflectionResult;
  const found = { force: [0, 0, 0], place } as unknown as Parameters<typeof withPulled>[0];
  expect(withPulled(found, question, answer)).toEqual({ ...found, force: question.force, answer });
  expect(withPulled(found, { ...question, joints: [0, 20] }, answer)).toBe(found);
  expect(withPulled(null, question, answer)).toBeNull();
});
