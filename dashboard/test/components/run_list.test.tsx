// @vitest-environment happy-dom
import { describe, expect, it } from "vitest";
import type { RunSummary } from "../../src/api/types";
import { chosen, Rows } from "../../src/components/list";
import { runRows } from "../../src/views/runs";
import { drawn } from "./drawn";

const run = (id: string, part: Partial<RunSummary> = {}): RunSummary => ({
  id,
  kind: "run",
  name: null,
  second_set_id: null,
  run_id: null,
  outputs: [],
  measurement_set_id: "s",
  robot_id: "r",
  robot_name: "KR 240",
  measurement_set_name: "campaign",
  serial_number: null,
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
    const rows = runRows(runs, null);
    expect(rows.map(({ id }) => id)).toEqual(["a", "lost"]);
    expect(rows[0]?.under?.map(({ id }) => id)).toEqual(["c", "b"]);
  });

  it("says what came of a run and whether it may be used", async () => {
    const root = await drawn(
      <Rows rows={runRows([run("a", { verdict: "do_not_use" }), run("b", { variant_of: "a" })], null)} />,
    );
    const [first] = root.querySelectorAll("li");
    expect(root.querySelectorAll("li")).toHaveLength(1);
    const row = first?.querySelector(".item")?.textContent ?? "";
    for (const part of ["Do not use", "98\u00a0%", "5 of 6", "2 warnings"]) expect(row).toContain(part);
    expect(first?.querySelector("details")?.textContent).toContain("1 further run");
  });

  it("walks its rows by arrow keys", async () => {
    const root = await drawn(<Rows rows={runRows([run("a"), run("b")], null)} />);
    document.body.append(root);
    const [first, second] = root.querySelectorAll<HTMLElement>("a.main");
    first?.focus();
    first?.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowDown", bubbles: true }));
    expect(document.activeElement).toBe(second);
    second?.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowUp", bubbles: true }));
    expect(document.activeElement).toBe(first);
  });
});

describe("what a list shows", () => {
  const row = (id: string, part: object = {}) => ({
    id,
    name: id,
    what: id,
    at: `2026-11-2${id.length}T12:00:00Z`,
    ...part,
  });
  const rows = [
    row("cell 10", { robot: "r", verdict: "use" as const, words: ["F-211034", "M. Keller"] }),
    row("cell 9", { robot: "s", verdict: "do_not_use" as const }),
    row("bench"),
  ];
  const none = { q: "", robot: "", verdict: "" as const, state: "all" as const, sort: "name" as const };
  const shown = (part: object) => chosen(rows, { ...none, ...part }).map(({ id }) => id);
  it("has all words somewhere", () => {
    expect(shown({ q: "keller CELL f-211" })).toEqual(["cell 10"]);
    expect(shown({ q: "keller roux" })).toEqual([]);
  });
  it("is of the robot and has the verdict", () => {
    expect(shown({ robot: "s" })).toEqual(["cell 9"]);
    expect(shown({ verdict: "use" })).toEqual(["cell 10"]);
  });
  it("stands in the order that is wanted", () => {
    expect(shown({})).toEqual(["bench", "cell 9", "cell 10"]);
    expect(shown({ sort: "newest" })).toEqual(["cell 10", "cell 9", "bench"]);
    expect(shown({ sort: "oldest" })).toEqual(["bench", "cell 9", "cell 10"]);
  });
});
