import { describe, expect, it } from "vitest";
import { roughTime, secondsLeft } from "../src/lib/format";

describe("the time left", () => {
  it("follows from the speed so far, not from what was done before", () => {
    expect(secondsLeft({ done: 500, at: 0 }, { done: 600, at: 2000 }, 1000)).toBe(8);
    expect(secondsLeft({ done: 0, at: 1000 }, { done: 1000, at: 3000 }, 1000)).toBe(0);
  });
  it("is not said before anything happened, nor when a job began anew", () => {
    expect(secondsLeft({ done: 5, at: 0 }, { done: 5, at: 0 }, 10)).toBeNull();
    expect(secondsLeft({ done: 5, at: 0 }, { done: 5, at: 900 }, 10)).toBeNull();
    expect(secondsLeft({ done: 5, at: 0 }, { done: 0, at: 900 }, 10)).toBeNull();
  });
  it("is rough", () =>
    expect([0.2, 7.4, 34, 89, 100, 5000, 7300].map(roughTime)).toEqual([
      "1 s",
      "7 s",
      "30 s",
      "90 s",
      "2 min",
      "83 min",
      "2 h",
    ]));
});
