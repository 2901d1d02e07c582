import { describe, expect, it } from "vitest";
import type { ImportAnswer } from "../src/api/types";
import { filesOf, isBlock, placed } from "../src/features/measure/paste";

const BLANK = { P1: { unloaded: "", loaded: "" }, P2: { unloaded: "", loaded: "" } };
const names = Object.keys(BLANK);
const rowsOf = async (block: string, target = "P1") => {
  const [files] = filesOf(block, names, target);
  return ((await files[1]?.text()) ?? "").split("\n").slice(1);
};
const answered = (readings: unknown[], faults: unknown[] = []) =>
  ({ faults, missing: [], measurement_set: { observations: [{ readings }] } }) as unknown as ImportAnswer;

describe("a block that is pasted", () => {
  it("is more than the numbers of one box", () => {
    expect(isBlock("1 2 3")).toBe(false);
    expect(isBlock("1,5 2,5 3")).toBe(false);
    expect(isBlock("1,5, 2,5, 3,5")).toBe(false);
    for (const block of ["1 2 3\n4 5 6", "1 2 3 4 5 6", "P2;1;2;3", "P1, 1.5, 2.5, 3.5"])
      expect(isBlock(block), block).toBe(true);
  });
  it("reaches the reader of imports with every line and every cell", async () => {
    expect(await rowsOf("P1;1,5;2;3;4;5;6\nQ;1;2;3;4;5;6")).toEqual(["P1;1,5;2;3;4;5;6", "Q;1;2;3;4;5;6"]);
    expect(await rowsOf("1\t2\t3\n4\t5\t6\n7\t8\t9")).toEqual([
      "P1;1;2;3;1;2;3",
      "P2;4;5;6;4;5;6",
      "line 3;7;8;9;7;8;9",
    ]);
    expect(await rowsOf("1.5, 2.5, 3.5, 4, 5, 6", "P2")).toEqual(["P2;1.5;2.5;3.5;4;5;6"]);
    expect(await rowsOf("1,5, 2,5, 3,5\nP2, 4,5, 5, 6")).toEqual(["P1;1,5;2,5;3,5;1,5;2,5;3,5", "P2;4,5;5;6;4,5;5;6"]);
    expect(await rowsOf("P1, 1,2,3\nP2, 4, 5, 6")).toEqual(["P1;1;2;3;1;2;3", "P2;4;5;6;4;5;6"]);
    expect(await rowsOf("P1,1.234,5\nP2 x y z")).toEqual(["P1;1.234;5", "P2;x;y;z;x;y;z"]);
  });
  it("fills the column that it was pasted into, or both", () => {
    const three = answered([{ target: "P2", unloaded: [1, 2, 3], loaded: [1, 2, 3] }]);
    expect(placed(three, BLANK, "loaded", "P2 1 2 3").rows).toEqual({
      ...BLANK,
      P2: { unloaded: "", loaded: "1 2 3" },
    });
    const six = answered([{ target: "P2", unloaded: [1, 2, 3], loaded: [4, 5, 6] }]);
    expect(placed(six, BLANK, "loaded", "P2 1 2 3 4 5 6").rows.P2).toEqual({ unloaded: "1 2 3", loaded: "4 5 6" });
  });
  it("asks about a name that the form does not have, and lays it on no other target", () => {
    const other = answered([{ target: "Q", unloaded: [1, 2, 3], loaded: [4, 5, 6] }]);
    const found = placed(other, BLANK, "unloaded", "Q 1 2 3 4 5 6");
    expect(found.rows).toEqual(BLANK);
    expect(found.unmatched).toEqual([{ name: "Q", typed: { unloaded: "1 2 3", loaded: "4 5 6" } }]);
  });
  it("lists what is not understood, with its line", () => {
    const fault = { line: 3, reason: "'y' is no number", remedy: "write a number" };
    const answer = { faults: [fault], missing: [], measurement_set: null } as unknown as ImportAnswer;
    const found = placed(answer, BLANK, "unloaded", "P1 1 2 3\nP2 x y z");
    expect(found.faults).toEqual(["line 2: 'y' is no number; write a number"]);
    expect(found.rows).toEqual(BLANK);
  });
});
