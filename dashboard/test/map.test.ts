import { describe, expect, it } from "vitest";
import { boxAround, greatest, parseMap, sliceOf, thinnest, valueOfPlace } from "../src/lib/map";

const HEAD = '"odd, name [rad]",header,of,no,interest';
const ROWS = [
  "reached,1.2,-0.6,0.4,0,3,0.1,0.2,1e-06,-2e-06,2e-06,3e-06,2.9e-06,3.1e-06,,,1e-09,2e-09,",
  "out_of_reach,9,0,0,,,,,,,,,,,,,,,",
];

describe("the table of a map", () => {
  const [first, second] = parseMap([HEAD, ...ROWS, ""].join("\r\n"));

  it("is read by the number of its joints", () => {
    expect(first?.joints).toEqual([0.1, 0.2]);
    expect(first?.position).toEqual([1.2, -0.6, 0.4]);
    expect(first?.displacement).toEqual([1e-6, -2e-6, 2e-6]);
    expect(first?.readingsOnly).toEqual([2.9e-6, 3.1e-6]);
    expect(first?.withModelError.every(Number.isNaN)).toBe(true);
    expect(first && valueOfPlace(first, "deflection")).toBeCloseTo(3);
    expect(first && valueOfPlace(first, "across")).toBeCloseTo(2e-3);
  });

  it("keeps why a place has no numbers", () => {
    expect(second?.status).toBe("out_of_reach");
    expect(second?.joints).toEqual([]);
    expect(second?.deflection).toBeNaN();
  });
});

describe("a slice", () => {
  it("has u along its rows and v up, z of the grid running fastest", () => {
    const slice = sliceOf([2, 3, 4], 2, 1);
    expect([slice.u, slice.v]).toEqual([0, 1]);
    expect(slice.cells).toEqual([
      [9, 21],
      [5, 17],
      [1, 13],
    ]);
  });

  it("takes every second place where they are many", () => {
    const slice = sliceOf([100, 1, 2], 2, 0);
    expect(slice.cells[0]).toHaveLength(50);
    expect(slice.cells[0]?.[1]).toBe(4);
  });

  it("is across the axis with fewest places", () => {
    expect(thinnest([9, 9, 2])).toBe(2);
    expect(thinnest([9, 1, 5])).toBe(1);
    expect(thinnest([2, 9, 5])).toBe(0);
  });
});

it("finds the greatest number", () => {
  expect(greatest([Number.NaN, 2, 7, 3])).toBe(2);
  expect(greatest([Number.NaN])).toBe(null);
});

it("puts a box around points, in whole centimetres", () => {
  expect(
    boxAround([
      [1.2345, 0, 0.5],
      [1.5, -0.25, 0.75],
    ]),
  ).toEqual([
    [1.18, -0.3, 0.45],
    [1.55, 0.05, 0.8],
  ]);
});
