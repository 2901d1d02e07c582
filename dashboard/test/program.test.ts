/** Points of a corrected program: its table, thinned paths, numbers typed by people. */
import { describe, expect, it } from "vitest";
import { binned, pointsOf, thinned } from "../src/lib/map";

const HEADS =
  "point,name,file,line,place x [m],place y [m],place z [m]," +
  "J1 [deg],J2 [deg],J3 [deg],J4 [deg],J5 [deg],J6 [deg],deflection [mm],residual [mm],remark";
const ROWS = [
  [1, 'a,"b"', "c.src", 7, 1.5, -2, 0.25, 90, 0, 0, 0, 0, -180, 1.25, 0.0001, ""],
  [2, "", "c.src", 8, 0, 0, 0, 0, 0, 0, 0, 0, 0, null, null, "no load"],
];

describe("points", () => {
  it("are read by the heads of their columns", () => {
    const columns = HEADS.split(",").map((head, i) => {
      const [name = "", unit = ""] = head.replace("]", "").split(" [");
      return { name, unit, values: ROWS.map((row) => row[i] ?? null) };
    });
    const [one, two] = pointsOf({ columns });
    expect([one?.number, one?.line]).toEqual([1, 7]);
    expect(one?.place).toEqual([1.5, -2, 0.25]);
    expect(one?.joints[0]).toBeCloseTo(Math.PI / 2);
    expect(one?.joints[5]).toBeCloseTo(-Math.PI);
    expect(one?.deflection).toBe(1.25);
    expect(two?.number).toBe(2);
    expect(two?.deflection).toBeNaN();
  });

  it("are thinned with both ends", () => {
    const points = Array.from({ length: 1001 }, (_, i) => i);
    const kept = thinned(points, 11);
    expect(kept).toHaveLength(11);
    expect([kept[0], kept[10]]).toEqual([0, 1000]);
    expect(thinned(points, 5000)).toBe(points);
  });
});

describe("the histogram of a path", () => {
  it("has bins of a round width, and counts what is finite", () => {
    const { width, counts } = binned([[0, 0.04, 0.051, 0.97, Number.NaN], [0.01]], 20);
    expect(width).toBe(0.05);
    expect(counts[0]?.length).toBe(20);
    expect([counts[0]?.[0], counts[0]?.[1], counts[0]?.[19], counts[1]?.[0]]).toEqual([2, 1, 1, 1]);
    expect(counts[0]?.reduce((sum, count) => sum + count, 0)).toBe(4);
  });

  it("has a bin without any value", () => expect(binned([[]], 20).counts).toEqual([Array(20).fill(0)]));
});
