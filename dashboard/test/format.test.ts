import { describe, expect, it } from "vitest";
import { clip, decimalsFor, fixed, percent, pValue, significant } from "../src/lib/format";

describe("digits from the uncertainty (GUM 7.2.6)", () => {
  it.each([
    [0.0173, 3],
    [0.21, 2],
    [2.1, 1],
    [17, 0],
    [170, -1],
    [17_000, -3],
    [0.0996, 2],
    [0.999, 1],
    [9.96, 0],
    [1, 1],
    [10, 0],
  ])("u = %f is written with %i decimals", (u, decimals) => expect(decimalsFor(u)).toBe(decimals));

  it("has no digits to offer where nothing is known", () => {
    for (const u of [0, -1, NaN, Infinity]) expect(decimalsFor(u)).toBe(0);
  });

  it("writes value and uncertainty to the same place", () => {
    const u = 17_166.4;
    expect(fixed(3_187_648.6, decimalsFor(u))).toBe("3\u202f188\u202f000");
    expect(fixed(u, decimalsFor(u))).toBe("17\u202f000");
    expect(fixed(3.1876486, decimalsFor(0.0171664))).toBe("3.188");
  });
});

describe("numbers as text", () => {
  it("groups thousands from five digits on and has a true minus", () => {
    expect(fixed(1234, 0)).toBe("1234");
    expect(fixed(-12345.678, 1)).toBe("\u221212\u202f345.7");
  });
  it("never shows a negative zero", () => expect(fixed(-0.0001, 2)).toBe("0.00"));
  it("says what is not finite", () => {
    expect([fixed(NaN, 2), fixed(Infinity, 2), fixed(-Infinity, 2)]).toEqual(["–", "∞", "\u2212∞"]);
  });
  it.each([
    [0.09528, 3, "0.0953"],
    [999.6, 3, "1000"],
    [1e-6, 2, "1.0×10⁻⁶"],
    [-0.0213, 2, "\u22120.021"],
    [0, 3, "0"],
    [2.5e9, 2, "2.5×10⁹"],
    [4.9e7, 1, "50\u202f000\u202f000"],
  ])("%f with %i significant digits", (value, digits, shown) => expect(significant(value, digits)).toBe(shown));
  it.each([
    [0.98, "98\u00a0%"],
    [0.9951, "99.5\u00a0%"],
    [1, "100\u00a0%"],
    [0.0022, "0.2\u00a0%"],
    [0, "0\u00a0%"],
    [-0.31, "\u221231\u00a0%"],
    [1e-9, "< 0.001\u00a0%"],
  ])("a share of %f", (share, shown) => expect(percent(share)).toBe(shown));
  it("keeps p values short", () =>
    expect([pValue(1e-9), pValue(0.0314), pValue(0.4465)]).toEqual(["p < 0.001", "p = 0.031", "p = 0.45"]));
  it("clips by characters, not by halves of them", () => expect(clip("🤖🤖🤖🤖", 3)).toBe("🤖🤖…"));
});
