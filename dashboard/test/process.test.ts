/** Tables of a process, and the request of what was filled in. */
import { expect, test } from "vitest";
import { polyline } from "../src/charts/along_path";
import { processPointsOf, searchedPlacesOf } from "../src/features/process/process";
import { requestOf } from "../src/features/process/form";

const column = (name: string, unit: string, values: (number | null)[]) => ({ name, unit, values });

test("points have the length of the path, and the widest known interval", () => {
  const points = {
    columns: [
      column("point", "", [1, 2, 3]),
      column("line", "", [4, 5, 6]),
      column("place x", "m", [0, 0.3, 0.3]),
      column("place y", "m", [0, 0, 0.4]),
      column("place z", "m", [1, 1, 1]),
      ...[1, 2, 3, 4, 5, 6].map((j) => column(`J${j}`, "deg", [0, 90, 0])),
    ],
  };
  const turns = {
    columns: [
      column("turn", "deg", [10, null, 20]),
      column("before", "mm", [0.4, 0.5, 0]),
      column("turned", "mm", [0.3, 0.4, 0]),
      column("turned low, readings", "mm", [0.29, 0.39, null]),
      column("turned high, readings", "mm", [0.31, 0.41, null]),
      column("turned low, with model error", "mm", [0.2, null, null]),
      column("turned high, with model error", "mm", [0.5, null, null]),
      column("remaining", "mm", [0.01, 0.02, 0]),
      column("remaining low, readings", "mm", [0, 0, null]),
      column("remaining high, readings", "mm", [0.03, 0.04, null]),
    ],
  };
  const found = processPointsOf(points, turns);
  expect(found.map(({ along }) => Math.round(along))).toEqual([0, 300, 700]);
  expect(found[0]?.intervals.turned).toEqual([0.2, 0.5]);
  expect(found[1]?.intervals.turned).toEqual([0.39, 0.41]);
  expect(found[0]?.intervals.left).toEqual([0, 0.03]);
  expect(found[0]?.intervals.before[1]).toBeNaN();
  expect(found[1]?.turn).toBeNaN();
  expect(found[1]?.joints[0]).toBeCloseTo(Math.PI / 2);
});

test("a place has its best turn, and one from which the path is not followed has none", () => {
  const table = {
    columns: [
      column("x", "m", [1, 1, 2, 2]),
      column("y", "m", [0, 0, 0, 0]),
      column("z", "m", [0.5, 0.5, 0.5, 0.5]),
      column("turn", "deg", [0, 180, 0, 180]),
      column("deflection", "m", [3e-4, 2e-4, null, null]),
    ],
  };
  const [first, second] = searchedPlacesOf(table);
  expect(searchedPlacesOf(table)).toHaveLength(2);
  expect([first?.deflection, first?.turn, first?.status]).toEqual([2e-4, 180, "reached"]);
  expect([second?.turn, second?.status]).toEqual([Number.NaN, "out_of_reach"]);
});

test("a place whose first turn is not reached has the number of a later one", () => {
  const table = {
    columns: [
      column("x", "m", [1, 1, 1]),
      column("y", "m", [0, 0, 0]),
      column("z", "m", [0.5, 0.5, 0.5]),
      column("turn", "deg", [0, 90, 180]),
      column("deflection", "m", [null, 2e-4, null]),
    ],
  };
  expect(searchedPlacesOf(table).map(({ deflection, turn }) => [deflection, turn])).toEqual([[2e-4, 90]]);
});

test("only what is chosen is posted", () => {
  const asked = {
    accuracy_option: "off",
    load: { force: [1, 2, 3] },
    cut: { teeth: 3 },
    range: "-30, 40",
    grid: [4, 4, 3],
    place: [
      [0, 0, 0],
      [1, 1, 1],
    ],
  };
  const rest = { accuracy_option: "off" };
  expect(requestOf({ ...asked, source: "load", turning: "free" }, undefined)).toEqual({
    ...rest,
    load: { force: [1, 2, 3] },
    turn: "free",
  });
  expect(requestOf({ ...asked, source: "cut", turning: "range" }, undefined)).toEqual({
    ...rest,
    cut: { teeth: 3 },
    turn: [-30, 40],
  });
  const placed = requestOf({ ...asked, source: "table", turning: "keep", placing: true }, "loads.csv");
  expect(placed).toEqual({ ...rest, loads: "loads.csv", turn: "keep", place: asked.place, grid: [4, 4, 3] });
  expect(requestOf({ ...asked, source: "load", turning: "range", range: "from here" }, undefined)["turn"]).toBe(
    "from here",
  );
});

test("a line stops where there is no value", () => {
  const same = (value: number) => value;
  expect(polyline([0, 1, 2, 3], [5, Number.NaN, 6, 7], same, same)).toBe("M0.0,5.0M2.0,6.0L3.0,7.0");
});
