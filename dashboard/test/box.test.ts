import { describe, expect, test } from "vitest";
import { type Box, boxAbout, boxIn, dragged, GRIPS, placeOf } from "../src/lib/box";
import { norm, subtract, times, type Vector } from "../src/lib/vector";

const BOX: Box = [
  [1, -0.5, 0.6],
  [1.8, 0.5, 1],
];
const toward = (vector: Vector): Vector => times(vector, 1 / norm(vector));
/** From an isometric corner, from straight above, and from the side. */
const CORNER = toward([-1, -1, -1]);
const ABOVE: Vector = [0, 0, -1];
const SIDE: Vector = [0, 1, 0];

/** What is dragged in the picture when a place moves by this vector. */
const inPicture = (by: Vector, look: Vector): Vector =>
  subtract(by, times(look, by[0] * look[0] + by[1] * look[1] + by[2] * look[2]));

describe("a box of a form", () => {
  test("is in the unit of the form, its corners in order", () => {
    const mm = [
      [1800, 500, 600],
      [1000, -500, 1000],
    ];
    expect(boxIn(mm, 1e-3)).toEqual(BOX);
  });
  test("is none while it is typed", () => {
    for (const value of [
      undefined,
      { unread: "1, 2" },
      [[1, 2, 3]],
      [
        [1, 2],
        [3, 4],
      ],
      [
        [1, 2, null],
        [4, 5, 6],
      ],
    ]) {
      expect(boxIn(value, 1)).toBeNull();
    }
  });
  test("about a point has numbers in steps", () => {
    expect(boxAbout([1.0034, 0, 0.7], [0.2, 0.2, 0.1])).toEqual([
      [0.8, -0.2, 0.6],
      [1.2, 0.2, 0.8],
    ]);
  });
});

describe("what is dragged", () => {
  test("a face follows the hand along its axis from every side that shows the axis", () => {
    for (const look of [CORNER, toward([-3, 1, -2]), SIDE]) {
      const move = inPicture([0.2, 0, 0], look);
      expect(dragged(BOX, { axis: 0, corner: 1 }, move, look)).toEqual([BOX[0], [2, 0.5, 1]]);
      expect(dragged(BOX, { axis: 0, corner: 0 }, move, look)).toEqual([[1.2, -0.5, 0.6], BOX[1]]);
    }
  });
  test("a face stops at the face opposite", () => {
    const down = inPicture([0, 0, -3], CORNER);
    expect(dragged(BOX, { axis: 2, corner: 1 }, down, CORNER)).toEqual([BOX[0], [1.8, 0.5, 0.6]]);
    const up = inPicture([0, 0, 3], CORNER);
    expect(dragged(BOX, { axis: 2, corner: 0 }, up, CORNER)).toEqual([[1, -0.5, 1], BOX[1]]);
  });
  test("a face whose axis is seen from its end stays", () => {
    expect(dragged(BOX, { axis: 2, corner: 1 }, [0.3, 0.1, 0], ABOVE)).toEqual(BOX);
  });
  test("the middle moves the box at its height, its size as before", () => {
    const move = inPicture([0.3, -0.1, 0], CORNER);
    expect(dragged(BOX, "middle", move, CORNER)).toEqual([
      [1.3, -0.6, 0.6],
      [2.1, 0.4, 1],
    ]);
  });
  test("seen from the side the middle moves up, too", () => {
    expect(dragged(BOX, "middle", [0.1, 0, 0.2], SIDE)).toEqual([
      [1.1, -0.5, 0.8],
      [1.9, 0.5, 1.2],
    ]);
  });
  test("each grip is on its face", () => {
    expect(GRIPS.map((grip) => placeOf(BOX, grip))).toEqual([
      [1, 0, 0.8],
      [1.8, 0, 0.8],
      [1.4, -0.5, 0.8],
      [1.4, 0.5, 0.8],
      [1.4, 0, 0.6],
      [1.4, 0, 1],
      [1.4, 0, 0.8],
    ]);
  });
});
