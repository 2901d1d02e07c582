import { describe, expect, it } from "vitest";
import { extent, linear, logarithmic, namedTicks, roundStep } from "../src/lib/format";

describe("linear axes", () => {
  it("ends at round numbers that hold the values", () => {
    const y = linear(0, 3.37, 300, 0);
    expect(y.ticks[0]).toBe(0);
    expect(y.ticks.at(-1)).toBeGreaterThanOrEqual(3.37);
    expect(y(0)).toBeCloseTo(300);
    expect(y(y.ticks.at(-1) ?? 0)).toBeCloseTo(0);
  });
  it("survives values that are all the same", () => expect(linear(5, 5, 0, 100)(5)).toBeGreaterThan(0));
  it("steps by 1, 2 or 5", () => {
    for (let span = 1e-6; span < 1e7; span *= 1.37) {
      const step = roundStep(span, 5);
      expect([1, 2, 5, 10]).toContain(Number((step / 10 ** Math.floor(Math.log10(step) + 1e-12)).toPrecision(6)));
      expect(span / step).toBeLessThanOrEqual(5 + 1e-9);
    }
  });
});

describe("logarithmic axes", () => {
  it("places equal ratios at equal distances", () => {
    const x = logarithmic(1e4, 1e7, 0, 300);
    expect(x(1e5) - x(1e4)).toBeCloseTo(x(1e7) - x(1e6));
  });
  it("has ticks inside, a few, whatever the range", () => {
    for (let ratio = 1.05; ratio < 1e12; ratio *= 1.6) {
      const x = logarithmic(3.3e4, 3.3e4 * ratio, 0, 100, 7);
      expect(x.ticks.length).toBeGreaterThanOrEqual(2);
      expect(x.ticks.length).toBeLessThanOrEqual(9);
      for (const tick of x.ticks) {
        expect(x(tick)).toBeGreaterThanOrEqual(-1e-6);
        expect(x(tick)).toBeLessThanOrEqual(100 + 1e-6);
      }
    }
  });
});

it("extent leaves out what is not finite", () => {
  expect(extent([3, NaN, -1, Infinity])).toEqual([-1, 3]);
  expect(extent([NaN])).toBeNull();
});

describe("names of ticks", () => {
  const widest = (names: { x: number; name: string }[]) =>
    names.slice(1).map(({ x, name }, i) => x - (names[i]?.x ?? 0) - 4.5 * (name.length + (names[i]?.name.length ?? 0)));
  it("do not touch in a narrow chart", () => {
    for (let width = 20; width < 400; width += 7) {
      const names = namedTicks(logarithmic(7e-3, 40, 10, width, 4), String);
      expect(names.length).toBeGreaterThan(0);
      expect(widest(names).every((gap) => gap > 0)).toBe(true);
    }
  });
  it("are all there where there is room", () => {
    const axis = logarithmic(7e-3, 40, 10, 300, 4);
    expect(namedTicks(axis, String)).toHaveLength(axis.ticks.length);
  });
});
