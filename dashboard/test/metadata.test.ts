import { describe, expect, it } from "vitest";
import { matches, notedIn, typedOf } from "../src/lib/metadata";

const NOTED = {
  measured_at: "2026-11-20T13:30:00Z",
  serial_number: "F-211034",
  item_condition: "as found",
  operator: "M. Keller",
  instrument: "Leica AT960, 750123",
  conditions: "21 °C",
  notes: "before\nthe repair",
};

describe("what is noted about a set", () => {
  it("comes back as it was, in this device's zone", () => {
    const typed = typedOf(NOTED);
    expect(typed.measured_at).toMatch(/^2026-11-2\dT\d\d:30$/);
    expect(notedIn(typed)).toEqual({ ...NOTED, measured_at: "2026-11-20T13:30:00.000Z" });
  });
  it("is nothing where nothing is typed", () => {
    const nothing = notedIn({ ...typedOf({}), operator: "  " });
    expect(new Set(Object.values(nothing ?? {}))).toEqual(new Set([null]));
  });
  it("is not sent while its time is none", () => expect(notedIn({ ...typedOf({}), measured_at: "soon" })).toBeNull());
});

describe("a filter of sets", () => {
  const set = { name: "Cell 3, dead weight", ...NOTED };
  const all = { words: "", from: "", to: "" };
  it("finds all words, wherever they stand", () => {
    expect(matches(set, { ...all, words: "keller cell f-211" })).toBe(true);
    expect(matches(set, { ...all, words: "keller roux" })).toBe(false);
    expect(matches({ name: "bare" }, all)).toBe(true);
  });
  it("finds days, both included", () => {
    const day = typedOf(NOTED).measured_at.slice(0, 10);
    expect(matches(set, { ...all, from: day, to: day })).toBe(true);
    expect(matches(set, { ...all, from: "2026-11-22" })).toBe(false);
    expect(matches(set, { ...all, to: "2026-11-18" })).toBe(false);
    expect(matches({ name: "bare" }, { ...all, from: "2020-01-01" })).toBe(false);
  });
});
