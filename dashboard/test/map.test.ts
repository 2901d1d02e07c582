import { describe, expect, it } from "vitest";
import { boxAround, greatest, placesOf, sliceOf, thinnest, valueOfPlace } from "../src/lib/map";

const NAMES = "status,x [m],y [m],z [m],direction,turn,x [rad],odd name [rad],dx [m],dy [m],dz [m],deflection [m],";
const HEADS = `${NAMES}readings only low [m],readings only high [m],with model error low [m],with model error high [m],`;
const LAST = "compliance along [m/N],compliance across [m/N],extrapolation [1]";
const ROWS = [
  ["reached", 1.2, -0.6, 0.4, 0, 3, 0.1, 0.2, 1e-6, -2e-6, 2e-6, 3e-6, 2.9e-6, 3.1e-6, null, null, 1e-9, 2e-9, null],
  ["out_of_reach", 9, 0, 0, ...Array.from({ length: 15 }, () => null)],
];

describe("the table of a map", () => {
  const columns = (HEADS + LAST).split(",").map((head, i) => {
    const [name = "", unit = ""] = head.replace("]", "").split(" [");
    return { name, unit, values: ROWS.map((row) => row[i] ?? null) };
  });
  const [first, second] = placesOf({ columns });

  it("is read by its heads, joints by their unit", () => {
    expect(first?.joints).toEqual([0.1, 0.2]);
    expect(first?.position).toEqual([1.2, -0.6, 0.4]);
    expect(first?.displacement).toEqual([1e-6, -2e-6, 2e-6]);
    expect(first?.readingsOnly).toEqual([2.9e-6, 3.1e-6]);
    expect(first?.withModelError.every(Number.isNaN)).toBe(true);
    expect(first && valueOfPlace(first, "deflection")).toBeCloseTo(3);
    expect(first && valueOfPlace(first, "across")).toBeCloseTo(2e-3);
    expect(first?.extrapolation).toBeNaN();
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
