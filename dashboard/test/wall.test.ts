import { describe, expect, it } from "vitest";
import type { RobotSummary } from "../src/api/types";
import { significanceOf, wallOf } from "../src/features/wall/rows";

const arm = (at: string, rank = 0, serial: string | null = null, tested = ["joint_1", "joint_2"]) => ({
  serial_number: serial,
  at,
  tested,
  rank,
});

const change = (joint: string, value: number, serial: string | null = null) => ({
  joint,
  serial_number: serial,
  change: { value, standard_uncertainty: 0.02 },
});

type Arms = ReturnType<typeof arm>[];
const robot = (id: string, arms: Arms, changed: ReturnType<typeof change>[] = [], name = id): RobotSummary =>
  ({
    id,
    name,
    created_at: "2026-01-01T00:00:00Z",
    joints: [{ name: "joint_1" }, { name: "joint_2" }],
    arms,
    last_campaign: { changed },
  }) as unknown as RobotSummary;

describe("the wall of robots", () => {
  it("has the worst arm first, then those measured last", () => {
    const rows = wallOf([
      robot("old", [arm("2026-01-01T00:00:00Z")]),
      robot("new", [arm("2026-05-01T00:00:00Z")]),
      robot("bad", [arm("2026-01-01T00:00:00Z", 30)]),
      robot("worst", [arm("2026-01-01T00:00:00Z", 1e6)]),
      robot("never", []),
    ]);
    expect(rows.map(({ name }) => name)).toEqual(["worst", "bad", "new", "old"]);
  });

  it("tells a joint that did not change from one that was not tested", () => {
    const [row] = wallOf([robot("a", [arm("2026-01-01T00:00:00Z", 0, null, ["joint_2"])])]);
    expect(row?.cells.map(({ change: found, tested }) => [found, tested])).toEqual([
      [null, false],
      [null, true],
    ]);
  });

  it("has a row for each arm, with its own date and its own changes", () => {
    const arms = [arm("2026-01-01T00:00:00Z", 1e6, "F-1"), arm("2026-07-01T00:00:00Z", 0, "F-2", [])];
    const rows = wallOf([robot("a", arms, [change("joint_1", -0.2, "F-1")])]);
    expect(rows.map(({ note, at, cells }) => [note, at.slice(5, 7), cells[0]?.change?.value ?? null])).toEqual([
      ["F-1", "01", -0.2],
      ["F-2", "07", null],
    ]);
  });

  it("tells robots of one name and one serial number apart", () => {
    const arms = [arm("2026-01-01T00:00:00Z")];
    const notes = wallOf([robot("first1", arms, [], "arm"), robot("second", arms, [], "arm")]).map(({ note }) => note);
    expect(new Set(notes).size).toBe(2);
    expect(notes.every((note) => note.startsWith("added "))).toBe(true);
  });

  it("never calls a change without uncertainty small", () => {
    expect(significanceOf({ value: 0.01, standard_uncertainty: null })).toBe(Number.POSITIVE_INFINITY);
  });
});
