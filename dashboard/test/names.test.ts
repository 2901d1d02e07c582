import { describe, expect, it } from "vitest";
import { toldApart } from "../src/state/names";

const robot = (id: string, name: string, created_at: string) => ({ id, name, created_at });
const set = (robot_id: string, serial_number: string | null = null) => ({ robot_id, serial_number });

describe("robots of one name", () => {
  it("are told apart by serial number, date and number of sets; others keep their name", () => {
    const names = toldApart(
      [
        robot("a", "KR 210", "2026-11-20T10:00:00Z"),
        robot("b", "KR 210", "2026-11-21T10:00:00Z"),
        robot("c", "other", "2026-11-21T10:00:00Z"),
      ],
      [set("a", "F-211034"), set("a", "F-211034"), set("b")],
    );
    expect([...names.values()]).toEqual([
      "KR 210 · F-211034 · 2026-11-20 · 2 sets",
      "KR 210 · 2026-11-21 · 1 set",
      "other",
    ]);
  });
});
