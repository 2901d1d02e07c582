import { describe, expect, it } from "vitest";
import { contentKey } from "../src/lib/hash";
import { link, parse } from "../src/state/router";
import { documentOf, newDh, numberOf } from "../src/views/dh_editor";

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
      numberOf("1,5"),
      numberOf(" -90 "),
      numberOf("\u221290"),
      numberOf(""),
      numberOf("-"),
      numberOf("1e400"),
    ]).toEqual([1.5, -90, -90, null, null, null]));
  it("sends SI", () => {
    const document = documentOf("arm", newDh());
    expect(document?.model).toMatchObject({ format: "dh", convention: "modified" });
    const row = document?.model.format === "dh" ? document.model.rows[1] : undefined;
    expect(row?.a).toBeCloseTo(0.35);
    expect(row?.alpha).toBeCloseTo(-Math.PI / 2);
  });
  it("sends nothing while something is no number", () => {
    const table = newDh();
    expect(documentOf("arm", { ...table, rows: [{ a: "1.", alpha: "x", d: "0", theta: "0" }] })).toBeNull();
  });
});
