// @vitest-environment happy-dom
import { describe, expect, it } from "vitest";
import type { RunSummary } from "../../src/api/types";
import { families, RunList } from "../../src/views/run_list";
import { drawn } from "./drawn";

const run = (id: string, part: Partial<RunSummary> = {}): RunSummary => ({
  id,
  measurement_set_id: "s",
  robot_id: "r",
  method: "partial_pose",
  weighting: "covariance",
  positive: true,
  elasticity: "joints",
  state: "succeeded",
  created_at: "2026-11-20T12:00:00Z",
  leave_out: [],
  variant_of: null,
  verdict: "use",
  compensation: 0.98,
  joints_identified: 5,
  joint_count: 6,
  warning_count: 2,
  ...part,
});

describe("a list of runs", () => {
  it("keeps variants of variants beneath the run they began with", () => {
    const runs = [
      run("c", { variant_of: "b" }),
      run("b", { variant_of: "a" }),
      run("a"),
      run("lost", { variant_of: "gone" }),
    ];
    const { roots, variants } = families(runs);
    expect(roots.map(({ id }) => id)).toEqual(["a", "lost"]);
    expect(variants.get("a")?.map(({ id }) => id)).toEqual(["c", "b"]);
  });

  it("says what came of a run and whether it may be used", async () => {
    const root = await drawn(
      <RunList runs={[run("a", { verdict: "do_not_use" }), run("b", { variant_of: "a" })]} names={null} />,
    );
    const [first] = root.querySelectorAll("li");
    expect(root.querySelectorAll("li")).toHaveLength(1);
    const row = first?.querySelector(".item")?.textContent ?? "";
    for (const part of ["Do not use", "98\u00a0%", "5/6", "2 warnings"]) expect(row).toContain(part);
    expect(first?.querySelector("details")?.textContent).toContain("1 variant");
  });
});
