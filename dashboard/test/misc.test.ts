import { describe, expect, it } from "vitest";
import { contentKey } from "../src/lib/hash";
import { link, parse } from "../src/state/router";
import type { DhModel } from "../src/api/types";
import { numberIn } from "../src/lib/entered";
import { documentOf, newDh, tableOf } from "../src/views/dh_editor";

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

const blank = { a: "", alpha: "", d: "", theta: "", lower: "", upper: "", kind: "revolute" as const };

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
  it("sends SI", () => {
    const rows = [{ ...blank, a: "350", alpha: "-90", upper: "85" }];
    const document = documentOf("arm", { ...newDh(), rows });
    expect(document?.model).toMatchObject({ format: "dh", convention: "modified" });
    const row = document?.model.format === "dh" ? document.model.rows[0] : undefined;
    expect(row).toMatchObject({ d: 0, theta: 0, lower: null });
    expect(row?.a).toBeCloseTo(0.35);
    expect(row?.alpha).toBeCloseTo(-Math.PI / 2);
    expect(row?.upper).toBeCloseTo((85 * Math.PI) / 180);
  });
  it("sends nothing while something is no number", () => {
    const table = newDh();
    expect(documentOf("arm", { ...table, rows: [{ ...blank, a: "1.", alpha: "x" }] })).toBeNull();
    expect(documentOf("arm", { ...table, rows: [{ ...blank, a: "1.", lower: "x" }] })).toBeNull();
  });
  it("sends a prismatic joint's limits as lengths, and shows them again in millimetres", () => {
    const rows = [{ ...blank, a: "350", kind: "prismatic" as const, lower: "-20", upper: "180" }];
    const document = documentOf("SCARA", { ...newDh(), rows });
    const model = document?.model as DhModel;
    expect(model.rows[0]).toMatchObject({ kind: "prismatic", lower: -0.02, upper: 0.18 });
    expect(tableOf(model, null).rows[0]).toMatchObject({ kind: "prismatic", lower: "-20", upper: "180" });
  });
  it("begins empty, and an empty table is no robot", () => {
    expect(
      newDh()
        .rows.flatMap(({ kind: _, ...row }) => Object.values(row))
        .join(""),
    ).toBe("");
    expect(documentOf("arm", newDh())).toBeNull();
  });
  it("shows a model in millimetres and degrees, and reads it back", () => {
    const model: DhModel = {
      format: "dh",
      convention: "standard",
      rows: [{ a: -0.57155, alpha: Math.PI / 2, d: 0.1807, theta: 0, lower: -Math.PI, upper: null, kind: "revolute" }],
    };
    const map = { matrix: [[-1]], offset: [0] };
    const table = tableOf(model, map);
    expect(table.rows).toEqual([
      { a: "-571.55", alpha: "90", d: "180.7", theta: "0", lower: "-180", upper: "", kind: "revolute" },
    ]);
    const read = documentOf("arm", table);
    expect(read?.joint_map).toEqual(map);
    expect(read?.model.format === "dh" && read.model.rows[0]?.a).toBeCloseTo(-0.57155, 12);
  });
});
