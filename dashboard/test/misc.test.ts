import { describe, expect, it, test } from "vitest";
import { contentKey } from "../src/lib/json";
import { link, parse } from "../src/state/action";
import type { DhModel } from "../src/api/types";
import { polyline } from "../src/charts/along_path";
import { numberIn } from "../src/lib/schema";
import { documentOf, newDh } from "../src/features/robots/new";

describe("addresses", () => {
  it("come back as they were made, whatever is in them", () => {
    for (const part of ["plain", "a/b", "ä ö", "<script>", "100%", "?x=#y"])
      expect(parse(link(["runs", part])).parts).toEqual(["runs", part]);
  });
  it("keep what is searched for", () => expect(parse(link(["runs"], { q: "a&b=c" })).query.get("q")).toBe("a&b=c"));
  it("survive broken escapes", () => expect(parse("#/runs/%E0%A4%A").parts).toEqual(["runs", "%E0%A4%A"]));
});

describe("keys of content", () => {
  it("are the same for the same, and differ for a digit", () => {
    expect(contentKey("set", { a: 1.5 })).toBe(contentKey("set", { a: 1.5 }));
    const keys = new Set(Array.from({ length: 2000 }, (_, i) => contentKey("set", { a: i })));
    expect(keys.size).toBe(2000);
    for (const key of keys) expect(key).toMatch(/^set-[a-z0-9]{10,40}$/);
  });
});

describe("the DH editor", () => {
  it("reads numbers as people type them", () =>
    expect([
      numberIn("1,5"),
      numberIn(" -90 "),
      numberIn("\u221290"),
      numberIn(""),
      numberIn("-"),
      numberIn("1e400"),
    ]).toEqual([1.5, -90, -90, null, Number.NaN, Number.NaN]));
  it("has no lengths where nothing was typed, and is no robot while something is no number", () => {
    expect(documentOf("arm", newDh())).toBeNull();
    const rows = [{ a: { unread: "1." }, kind: "revolute" }];
    expect(documentOf("arm", { ...newDh(), model: { ...newDh().model, rows } })).toBeNull();
  });
  it("counts a blank cell as 0, a blank limit as none", () => {
    const model = { ...newDh().model, rows: [{ a: 0.35, alpha: null, upper: 1.5, kind: "revolute" }] };
    const map = { matrix: [[-1]], offset: [0] };
    const document = documentOf("arm", { model, map });
    expect(document).toMatchObject({ name: "arm", joint_map: map, model: { format: "dh", convention: "modified" } });
    const read = document?.model as DhModel | undefined;
    expect(read?.rows).toEqual([{ a: 0.35, alpha: 0, d: 0, theta: 0, upper: 1.5, kind: "revolute" }]);
  });
});

test("a line stops where there is no value", () => {
  const same = (value: number) => value;
  expect(polyline([0, 1, 2, 3], [5, Number.NaN, 6, 7], same, same)).toBe("M0.0,5.0M2.0,6.0L3.0,7.0");
});
