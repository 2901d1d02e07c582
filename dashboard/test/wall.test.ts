import { describe, expect, it } from "vitest";
import type { RobotSummary } from "../src/api/types";
import { significanceOf, wallOf } from "../src/features/fleet/rows";

const change = (joint: string, value: number, u: number | null, serial: string | null = null) => ({
  joint,
  serial_number: serial,
  change: { value, standard_uncertainty: u },
});

const robot = (id: string, at: string | null, changed: ReturnType<typeof change>[] = []): RobotSummary =>
  ({
    id,
    name: id,
    created_at: "2026-01-01T00:00:00Z",
    joints: [{ name: "joint_1" }, { name: "joint_2" }],
    last_campaign: at === null ? null : { run_id: "r", at, serial_number: null, verdict: "use", changed },
  }) as unknown as RobotSummary;

describe("the wall of robots", () => {
  it("has the worst first: softer by most uncertainties, then stiffer, then those measured last", () => {
    const rows = wallOf([
      robot("old", "2026-01-01T00:00:00Z"),
      robot("new", "2026-05-01T00:00:00Z"),
      robot("stiffer", "2026-01-01T00:00:00Z", [change("joint_1", 0.5, 0.01)]),
      robot("softer", "2026-01-01T00:00:00Z", [change("joint_2", -0.1, 0.02)]),
      robot("softest", "2026-01-01T00:00:00Z", [change("joint_2", -0.1, 0.01)]),
      robot("never", null),
    ]);
    expect(rows.map(({ name }) => name)).toEqual(["softest", "softer", "stiffer", "new", "old"]);
  });

  it("has a cell for each joint, empty where no change is known", () => {
    const [row] = wallOf([robot("a", "2026-01-01T00:00:00Z", [change("joint_2", -0.1, 0.02)])]);
    expect(row?.cells.map(({ change: found }) => found?.value ?? null)).toEqual([null, -0.1]);
  });

  it("has a row of its own for another arm that changed", () => {
    const rows = wallOf([robot("a", "2026-01-01T00:00:00Z", [change("joint_1", -0.2, 0.02, "F-1")])]);
    expect(rows.map(({ serial }) => serial)).toEqual(["F-1", null]);
  });

  it("never calls a change without uncertainty small", () => {
    expect(significanceOf({ value: 0.01, standard_uncertainty: null })).toBe(Number.POSITIVE_INFINITY);
  });
});
