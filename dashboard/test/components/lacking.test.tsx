// @vitest-environment happy-dom
import { expect, it, vi } from "vitest";
import type { RunContext } from "../../src/state/run_context";
import { ProgramForm } from "../../src/features/use/forms";
import { lackOf } from "../../src/features/readings/import";
import { ImportTable } from "../../src/features/readings/import_table";
import type { FilePreview } from "../../src/features/readings/imports";
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

const column = (number: number, header: string) => ({ column: number, header, meaning: "unknown", unit: null });
const UNNAMED = {
  file: "a.xlsx",
  columns: [column(1, "Drehen [deg]"), column(2, "Heben [deg]"), column(3, "Druck [bar]"), column(4, "Feuchte [%]")],
  first_rows: [["10", "-20", "1013", "40"]],
  first_lines: [2],
  fault_rows: [],
  fault_lines: [],
  assumptions: [],
};

it("an import without a robot asks for the robot first, where columns may be its joints", () => {
  const answer = { files: [UNNAMED], faults: [], missing_fields: [] } as unknown as Parameters<typeof lackOf>[0];
  expect(lackOf(answer, "")).toBe("Choose the robot first: columns that were not understood may be its joints");
  expect(lackOf(answer, "robot")).toBe("Choose the columns that were not understood");
});

it("columns that may be joints are not ignored by one click before a robot is chosen", async () => {
  const preview = UNNAMED as unknown as FilePreview;
  const table = (robot: string) => (
    <ImportTable {...{ preview, faults: [], options: {}, change: () => {}, groups: [], robot }} />
  );
  const before = (await drawn(table(""))).textContent;
  expect(before).toContain("Ignore the 2 columns that were not understood");
  expect(before).toContain("Choose the robot first");
  const after = (await drawn(table("robot"))).textContent;
  expect(after).toContain("Ignore the 4 columns that were not understood");
  expect(after).not.toContain("Choose the robot first");
});
