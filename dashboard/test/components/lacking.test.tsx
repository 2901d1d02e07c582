// @vitest-environment happy-dom
import { expect, it, vi } from "vitest";
import type { RunContext } from "../../src/state/run_context";
import { ProgramForm } from "../../src/features/use/forms";
import { lackOf } from "../../src/features/readings/import";
import { drawn, settled } from "./drawn";

vi.stubGlobal("fetch", async () => new Response(JSON.stringify({ components: { schemas: {} } })));

it("a form says beside its button what it needs", async () => {
  const root = await drawn(
    <ProgramForm context={{ run: { id: "r" }, robot: { id: "a", joints: [] } } as unknown as RunContext} />,
  );
  await settled(() => {});
  const button = [...root.querySelectorAll("button")].find(({ textContent }) => textContent === "Compensate");
  expect(button?.disabled).toBe(true);
  expect(button?.nextElementSibling?.textContent).toBe("Choose the program");
});

it("an import says all that is missing", () => {
  const answer = { files: [], faults: [], missing_fields: ["load_point", "encoders", "load_point"] };
  expect(lackOf(answer as unknown as Parameters<typeof lackOf>[0], "robot")).toBe(
    "Give the load point. Choose the encoders that close the position loop",
  );
});
