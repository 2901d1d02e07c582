import { describe, expect, it } from "vitest";
import type { RobotSummary } from "../src/api/types";
import { robotsToldApart } from "../src/state/choices";

const robot = (id: string, name: string, created_at: string, serial_number?: string) => ({
  id,
  name,
  created_at,
  joints: Array.from({ length: 6 }) as RobotSummary["joints"],
  last_campaign: serial_number
    ? ({ serial_number, at: "2026-11-22T10:00:00Z" } as RobotSummary["last_campaign"])
    : null,
});

describe("robots of one name", () => {
  it("are told apart by serial number, joints and last campaign; others keep their name", () => {
    const names = robotsToldApart([
      robot("a", "KR 210", "2026-11-20T10:00:00Z", "F-211034"),
      robot("b", "KR 210", "2026-11-21T10:00:00Z"),
      robot("c", "other", "2026-11-21T10:00:00Z"),
    ]);
    expect([...names.values()]).toEqual([
      "KR 210 · F-211034 · 6 joints · measured 22 Nov 2026",
      "KR 210 · 6 joints · added 21 Nov 2026",
      "other",
    ]);
  });

  it("are told apart by a part of the id where all else is the same", () => {
    const twins = ["abcdef01", "abcdef02x", "123456"].map((id) => robot(id, "KR 210", "2026-11-20T10:00:00Z"));
    const names = [...robotsToldApart(twins).values()];
    expect(names[2]).toBe("KR 210 · 6 joints · added 20 Nov 2026 · 123456");
  });
});
