import { describe, expect, it } from "vitest";
import { numberIn, posted, vectorIn } from "../src/lib/schema";

describe("numbers as typed", () => {
  it("reads points and commas, and knows nothing from something that is no number", () => {
    expect(["1.5", " 1,5 ", "-2", "\u22122", "1e6", ".5", ""].map(numberIn)).toEqual([
      1.5,
      1.5,
      -2,
      -2,
      1e6,
      0.5,
      null,
    ]);
    expect(["a", "1.2.3", "1 000", "0x10", "Infinity", "1,2,3"].map(numberIn)).toEqual(Array(6).fill(Number.NaN));
  });

  it("posts the number in the service's unit, and what is none as it was typed", () => {
    expect(posted("0.86", 1e6)).toBe(860_000);
    expect(posted("", 1e6)).toBeNull();
    expect(posted(" many ", 1e6)).toBe("many");
  });

  it("reads three numbers with any mark between them", () => {
    for (const typed of ["0 0.5 120", "0, 0.5, 120", "0;0,5;120", "0,0.5,120", "(0, 0.5, 120)"])
      expect(vectorIn(typed)).toEqual([0, 0.5, 120]);
    expect(vectorIn("  ")).toBeNull();
    for (const typed of ["1 2", "1,2", "0,5,1,2", "a b c", "1 2 3 4"]) expect(vectorIn(typed)).toBeUndefined();
  });
});
