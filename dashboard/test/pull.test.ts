import { describe, expect, test } from "vitest";
import { forceAt, forceByKey, headOf, type Pull } from "../src/lib/pull";

const PULL: Pull = { from: [1.5, 0, 0.8], force: [0, 0, -500], scale: 1e-3 };

describe("a force that is pulled", () => {
  test("is as its arrow: the head of a force gives that force", () => {
    expect(headOf(PULL)).toEqual([1.5, 0, 0.30000000000000004]);
    expect(forceAt(PULL, headOf(PULL))).toEqual([0, 0, -500]);
  });
  test("stops at tens of newtons, and at an axis that it is near", () => {
    expect(forceAt(PULL, [1.8034, 0.2, 0.8])).toEqual([300, 200, 0]);
    expect(forceAt(PULL, [1.51, 0, 1.2])).toEqual([0, 0, 400]);
    expect(forceAt(PULL, PULL.from)).toEqual([0, 0, 0]);
  });
  test("follows arrow keys as they are seen: along the level axis nearest to the right, and up and down", () => {
    expect(forceByKey(PULL.force, "ArrowUp", [1, 0, 0])).toEqual([0, 0, -490]);
    expect(forceByKey(PULL.force, "ArrowRight", [-0.6, 0.8, 0])).toEqual([0, 10, -500]);
    expect(forceByKey(PULL.force, "ArrowLeft", [-0.9, 0.1, 0])).toEqual([10, 0, -500]);
    expect(forceByKey([0, 0, -10], "ArrowUp", [1, 0, 0])).toEqual([0, 0, 0]);
    expect(forceByKey(PULL.force, "a", [1, 0, 0])).toBeNull();
  });
});
