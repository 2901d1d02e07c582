import { describe, expect, it } from "vitest";
import { notedIn, typedOf, wasMeasured } from "../src/lib/campaign";

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

describe("days of a filter", () => {
  const all = { from: "", to: "" };
  it("are both included", () => {
    const day = typedOf(NOTED).measured_at.slice(0, 10);
    expect(wasMeasured(NOTED, { from: day, to: day })).toBe(true);
    expect(wasMeasured(NOTED, { ...all, from: "2026-11-22" })).toBe(false);
    expect(wasMeasured(NOTED, { ...all, to: "2026-11-18" })).toBe(false);
    expect(wasMeasured({}, { ...all, from: "2020-01-01" })).toBe(false);
    expect(wasMeasured({}, all)).toBe(true);
  });
});
