/** Points of a compensated program: a table with quoted names, thinned paths, numbers typed by people. */
import { describe, expect, it } from "vitest";
import { numbersIn, parsePoints, thinned } from "../src/lib/program";

const HEAD =
  "point,name,file,line,place x [m],place y [m],place z [m]," +
  "J1 [deg],J2 [deg],J3 [deg],J4 [deg],J5 [deg],J6 [deg],deflection [mm],residual [mm],remark";

describe("points", () => {
  it("are read with quoted names and empty cells", () => {
    const [one, two] = parsePoints(
      `${HEAD}\n1,"a,""b""",c.src,7,1.5,-2,0.25,90,0,0,0,0,-180,1.25,0.0001,\n2,,c.src,8,0,0,0,0,0,0,0,0,0,,,no load\n`,
    );
    expect(one?.name).toBe('a,"b"');
    expect(one?.line).toBe(7);
    expect(one?.place).toEqual([1.5, -2, 0.25]);
    expect(one?.joints[0]).toBeCloseTo(Math.PI / 2);
    expect(one?.joints[5]).toBeCloseTo(-Math.PI);
    expect(one?.deflection).toBe(1.25);
    expect(two?.deflection).toBeNaN();
    expect(parsePoints(`${HEAD}\n,x,c.src,9,1,2,3,0,0,0,0,0,0,,,\n`)[0]?.line).toBe(9);
  });

  it("are thinned with both ends", () => {
    const points = Array.from({ length: 1001 }, (_, i) => i);
    const kept = thinned(points, 11);
    expect(kept).toHaveLength(11);
    expect([kept[0], kept[10]]).toEqual([0, 1000]);
    expect(thinned(points, 5000)).toBe(points);
  });

  it("take numbers however they are parted", () => {
    expect(numbersIn("1, 2;3\n-4.5")).toEqual([1, 2, 3, -4.5]);
    expect(numbersIn("1, x")).toBeNull();
    expect(numbersIn(" ")).toEqual([]);
  });
});
