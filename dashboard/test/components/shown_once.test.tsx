// @vitest-environment happy-dom
import { describe, expect, it } from "vitest";
import type { JointResult, Run } from "../../src/api/types";
import { Show } from "../../src/components/basics";
import { RunsTable } from "../../src/features/run/stiffness";
import { drawn, press } from "./drawn";

const FAILED = { data: undefined, isFetching: false, isStand: false };

describe("what was deleted", () => {
  const problem = {
    type: "urn:jointstiff:problem:deleted",
    title: "The resource was deleted",
    status: 404,
    detail: "the run was deleted",
    where: null,
    remedy: 'restore it with PATCH /v1/jobs/r {"deleted": false}',
    request_id: null,
    errors: [],
  };

  it("comes back by one tap, in place of a request to type", async () => {
    const done: string[] = [];
    const root = await drawn(
      <Show of={{ ...FAILED, problem, refetch: () => done.push("loaded") }} restore={async () => done.push("restored")}>
        {() => null}
      </Show>,
    );
    expect(root.textContent).not.toContain("PATCH");
    await press(root, "Restore");
    expect(done).toEqual(["restored", "loaded"]);
  });

  it("has no such button where something else failed", async () => {
    const gone = { ...problem, type: "urn:jointstiff:problem:not-found", remedy: "check the address" };
    const root = await drawn(
      <Show of={{ ...FAILED, problem: gone, refetch: () => undefined }} restore={async () => undefined}>
        {() => null}
      </Show>,
    );
    expect(root.textContent).toContain("Check the address");
    expect(root.textContent).not.toContain("Restore");
  });
});

describe("runs side by side", () => {
  it("show a joint as its run does: only a lower limit where the interval has no upper end", async () => {
    const joint = {
      name: "joint_1",
      status: "uncertain",
      verdict: "use_with_care",
      compliance: 2.8e-7,
      stiffness: 3.6e6,
      standard_uncertainty: 3e-7,
      stiffness_interval: [8.4e5, null],
      stiffness_at_least: null,
      kind: "revolute",
    } as unknown as JointResult;
    const result = { assessment: { verdict: "use" }, joints: [joint], compensation: 0.9, rms_residual: 2e-5 };
    const run = { id: "r", request: { confidence: 0.95 }, result } as unknown as Run;
    const root = await drawn(<RunsTable columns={[{ run, name: "one" }]} label="runs" />);
    expect(root.querySelector("tbody tr:last-child td b")?.textContent).toBe("> 0.84");
  });
});
