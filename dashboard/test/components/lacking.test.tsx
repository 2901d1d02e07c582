// @vitest-environment happy-dom
import { expect, it, vi } from "vitest";
import type { RunContext } from "../../src/state/run_context";
import { CorrectForm } from "../../src/features/use/forms";
import { lackOf } from "../../src/features/readings/import";
import { drawn, settled } from "./drawn";

vi.stubGlobal("fetch", async () => new Response(JSON.stringify({ components: { schemas: {} } })));

it("a form says beside its button what it needs", async () => {
  const root = await drawn(
    <CorrectForm context={{ run: { id: "r" }, robot: { id: "a", joints: [] } } as unknown as RunContext} />,
  );
  await settled(() => {});
  const button = [...root.querySelectorAll("button")].find(({ textContent }) => textContent === "Correct");
  expect(button?.disabled).toBe(true);
  expect(button?.nextElementSibling?.textContent).toBe("Choose the program");
});

it("an import says what it needs: the robot, then answers, then a correction", () => {
  const answer = (questions: number, faults: string[]) =>
    ({ questions: Array(questions).fill({}), faults }) as unknown as Parameters<typeof lackOf>[0];
  expect(lackOf(answer(2, []), "")).toBe("Which robot was measured?");
  expect(lackOf(answer(1, ["far"]), "robot")).toBe("1 question is open");
  expect(lackOf(answer(0, ["far"]), "robot")).toBe("Correct what is wrong first");
  expect(lackOf(answer(0, []), "robot")).toBeNull();
});
