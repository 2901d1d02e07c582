import { describe, expect, it } from "vitest";
import { measuredBetween, notedIn, typedOf } from "../src/lib/campaign";

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
  it("are both included, in this device's zone", () => {
    const day = typedOf(NOTED).measured_at.slice(0, 10);
    const { measured_from: from, measured_to: to } = measuredBetween({ from: day, to: day });
    const time = Date.parse(NOTED.measured_at);
    expect(Date.parse(from ?? "") <= time && time < Date.parse(to ?? "")).toBe(true);
    expect(Date.parse(to ?? "") - Date.parse(from ?? "")).toBe(24 * 3600 * 1000);
    expect(new Date(from ?? "").getHours()).toBe(0);
  });
  it("are none where none is typed", () =>
    expect(measuredBetween({ from: "", to: "" })).toEqual({ measured_from: null, measured_to: null }));
});
