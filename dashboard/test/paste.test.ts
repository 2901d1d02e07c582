import { describe, expect, it } from "vitest";
import { isBlock, placed } from "../src/features/measure/paste";

const BLANK = { P1: { unloaded: "", loaded: "" }, P2: { unloaded: "", loaded: "" } };
const pasted = (text: string, target = "P1", column: "unloaded" | "loaded" = "unloaded", rows = BLANK) =>
  placed({ target, column, text }, rows);

describe("a block that is pasted", () => {
  it("is more than the numbers of one box", () => {
    expect(isBlock("1 2 3")).toBe(false);
    expect(isBlock("1,5 2,5 3")).toBe(false);
    expect(isBlock("1,5, 2,5, 3,5")).toBe(false);
    for (const block of ["1 2 3\n4 5 6", "1 2 3 4 5 6", "P2;1;2;3", "P1, 1.5, 2.5, 3.5"])
      expect(isBlock(block), block).toBe(true);
  });
  it("is read with every line and every cell, whatever parts them", () => {
    const both = (unloaded: string, loaded: string) => ({ unloaded, loaded });
    expect(pasted("P1;1,5;2;3;4;5;6").rows.P1).toEqual(both("1.5 2 3", "4 5 6"));
    expect(pasted("1\t2\t3\n4\t5\t6").rows).toEqual({ P1: both("1 2 3", ""), P2: both("4 5 6", "") });
    expect(pasted("1.5, 2.5, 3.5, 4, 5, 6", "P2").rows.P2).toEqual(both("1.5 2.5 3.5", "4 5 6"));
    expect(pasted("1,5, 2,5, 3,5\nP2, 4,5, 5, 6").rows).toEqual({
      P1: both("1.5 2.5 3.5", ""),
      P2: both("4.5 5 6", ""),
    });
    expect(pasted("P1, 1,2,3\nP2, 4, 5, 6").rows).toEqual({ P1: both("1 2 3", ""), P2: both("4 5 6", "") });
  });
  it("fills the column that it was pasted into, and leaves what was typed into others", () => {
    const typed = { ...BLANK, P2: { unloaded: "7 8 9", loaded: "" } };
    expect(pasted("P2 1 2 3", "P1", "loaded", typed).rows).toEqual({
      ...BLANK,
      P2: { unloaded: "7 8 9", loaded: "1 2 3" },
    });
  });
  it("asks about a name that the form does not have, and lays it on no other target", () => {
    const found = pasted("Q 1 2 3 4 5 6\n1 2 3\n4 5 6");
    expect(found.rows).toEqual({ ...BLANK, P2: { unloaded: "1 2 3", loaded: "" } });
    expect(found.unmatched).toEqual([
      { name: "Q", typed: { unloaded: "1 2 3", loaded: "4 5 6" } },
      { name: "line 3", typed: { unloaded: "4 5 6" } },
    ]);
  });
  it("lists lines that are not understood, and reads the others", () => {
    const found = pasted("P1 1 2 3\nP2 x y z\nP2;1.234;5");
    expect(found.faults).toEqual([
      "line 2, “P2 x y z”: write three numbers, or six for both states",
      "line 3, “P2;1.234;5”: write three numbers, or six for both states",
    ]);
    expect(found.rows).toEqual({ ...BLANK, P1: { unloaded: "1 2 3", loaded: "" } });
  });
});
