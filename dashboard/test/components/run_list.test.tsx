// @vitest-environment happy-dom
import { act } from "preact/test-utils";
import { describe, expect, it } from "vitest";
import type { RunSummary } from "../../src/api/types";
import { Rows, wanted } from "../../src/components/list";
import { JobList, runRows } from "../../src/features/runs/view";
import { answering, drawn, settled } from "./drawn";

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
    const rows = runRows(runs);
    expect(rows.map(({ id }) => id)).toEqual(["a", "lost"]);
    expect(rows[0]?.under?.map(({ id }) => id)).toEqual(["c", "b"]);
  });

  it("says what came of a run and whether it may be used", async () => {
    const root = await drawn(
      <Rows rows={runRows([run("a", { verdict: "do_not_use" }), run("b", { variant_of: "a" })])} />,
    );
    const [first] = root.querySelectorAll("li");
    expect(root.querySelectorAll("li")).toHaveLength(1);
    const row = first?.querySelector(".item")?.textContent ?? "";
    for (const part of ["Do not use", "98\u00a0%", "5 of 6", "2 warnings"]) expect(row).toContain(part);
    expect(first?.querySelector("details")?.textContent).toContain("1 further run");
  });

  it("walks its rows by arrow keys", async () => {
    const root = await drawn(<Rows rows={runRows([run("a"), run("b")])} />);
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
  const all = { robot: "", verdict: "" as const, state: "all" as const, from: "", to: "" };
  const none = { q: "", sort: "newest" as const, ...all };
  it("is searched and sorted by the service, which knows all of it", () => {
    expect(wanted(none)).toEqual({ q: null, sort: "-created_at" });
    expect(wanted({ ...none, q: " check 0012 ", sort: "name" })).toEqual({ q: "check 0012", sort: "name" });
    expect(wanted({ ...none, sort: "oldest" }).sort).toBe("created_at");
  });

  it("finds one run of 2,000 in one request, and counts them truly", async () => {
    const all = Array.from({ length: 2000 }, (_, i) => run(`r${i}`, { measurement_set_name: `check ${i}` }));
    const asked: string[] = [];
    answering(({ path }) => {
      const query = new URL(path, "http://x").searchParams;
      if (!path.startsWith("/v1/jobs")) return { items: [], next: null, total: 0 };
      asked.push(path);
      const found = all.filter((one) => one.measurement_set_name?.includes(query.get("q") ?? ""));
      return { items: found.slice(0, 100), next: found.length > 100 ? "100" : null, total: found.length };
    });
    const root = await drawn(<JobList collection="runs" />);
    await settled(() => {});
    expect(root.querySelector("p[role=status]")?.textContent).toBe("100 of 2000");
    const box = root.querySelector<HTMLInputElement>("input[type=search]");
    await settled(() => {
      if (box) box.value = "check 1912";
      box?.dispatchEvent(new Event("input", { bubbles: true }));
    });
    await settled(() => {});
    await act(() => new Promise((done) => setTimeout(done, 350)));
    await settled(() => {});
    await settled(() => {});
    expect(root.querySelector("p[role=status]")?.textContent).toBe("1 in all");
    expect(root.querySelector(".rows")?.textContent).toContain("check 1912");
    expect(asked).toHaveLength(2);
  });
});
