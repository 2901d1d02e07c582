// @vitest-environment happy-dom
import { expect, it } from "vitest";
import type { Assessment, Run } from "../../src/api/types";
import { VerdictCard } from "../../src/components/job_page";
import type { RunContext } from "../../src/state/run_context";
import { drawn } from "./drawn";

it.each([
  [5, 6, "The readings support the stiffness of 5 of 6 joints."],
  [6, 6, "The readings support the stiffness of all 6 joints."],
  [null, null, "The readings support these stiffnesses."],
])("says how many joints the readings support: %s of %s", async (identified, count, said) => {
  const assessment = {
    verdict: "use" as const,
    reasons: [],
    notes: [],
    joints_identified: identified,
    joint_count: count,
    headline: null,
    questions: [],
  };
  const root = await drawn(<VerdictCard assessment={assessment} context={null} />);
  expect(root.querySelector("h2")?.textContent).toContain(said);
});

it("offers what removes two reasons once, with the first of them", async () => {
  const empty = { observations: [], joints: [], joint_map: [], offset: [], target: null, causes: [], unit: null };
  const reasons = (["work_negative", "no_joint_identified"] as const).map((code) => ({
    code,
    weight: "do_not_use",
    where: null,
    observation: null,
    message: code,
    remedy: "exchange unloaded and loaded readings",
    action: { ...empty, kind: "exchange_readings" },
  }));
  const assessment = {
    verdict: "do_not_use",
    reasons,
    notes: [],
    headline: null,
    questions: [],
  } as unknown as Assessment;
  const context = { run: { id: "r" } as Run } as RunContext;
  const root = await drawn(<VerdictCard assessment={assessment} context={context} />);
  const [first, second] = [...root.querySelectorAll("ul > li")].map((item) => item.querySelectorAll("button").length);
  expect([first, second]).toEqual([1, 0]);
});

it.each([
  [[], "Exchange unloaded and loaded and repeat"],
  [["P10", "P12"], "Exchange unloaded and loaded of P10, P12 and repeat"],
])("names the targets whose readings are exchanged: %j", async (targets, label) => {
  const empty = { observations: [], joints: [], joint_map: [], offset: [], target: null, causes: [], unit: null };
  const reason = {
    code: "deflection_against_force",
    weight: "do_not_use",
    where: null,
    observation: null,
    message: "readings are exchanged",
    remedy: "exchange the readings",
    action: { ...empty, kind: "exchange_readings", targets },
  };
  const assessment = {
    verdict: "do_not_use",
    reasons: [reason],
    notes: [],
    headline: null,
    questions: [],
  } as unknown as Assessment;
  const context = { run: { id: "r" } as Run } as RunContext;
  const root = await drawn(<VerdictCard assessment={assessment} context={context} />);
  expect(root.querySelector("ul > li button")?.textContent).toBe(label);
});

it("offers each unit of force that is plausible on a button of its own", async () => {
  const empty = { observations: [], joints: [], joint_map: [], offset: [], target: null, causes: [] };
  const plausible = (unit: "kgf" | "lbf") => ({
    code: "stiffness_against_payload" as const,
    weight: "use_with_care" as const,
    where: null,
    observation: null,
    message: `forces in ${unit}, not in N as declared, would give 94 rad⁻¹`,
    remedy: `check in which unit the forces were read; if in ${unit}, set units.force to ${unit}`,
    action: { ...empty, kind: "convert_units" as const, unit },
  });
  const assessment = {
    verdict: "use_with_care" as const,
    reasons: (["kgf", "lbf"] as const).map(plausible),
    notes: [],
    joints_identified: 6,
    joint_count: 6,
    headline: null,
    questions: [],
  };
  const context = { run: { id: "r" } } as RunContext;
  const root = await drawn(<VerdictCard assessment={assessment} context={context} />);
  expect([...root.querySelectorAll("button")].map((button) => button.textContent)).toEqual([
    "Read the numbers in kgf and repeat",
    "Read the numbers in lbf and repeat",
  ]);
});

it("offers each robot that fits on a button of its own, the best first", async () => {
  const empty = { observations: [], joints: [], joint_map: [], offset: [], target: null, causes: [], unit: null };
  const fitting = (robot: string) => ({
    code: "another_robot_fits" as const,
    weight: "do_not_use" as const,
    where: null,
    observation: null,
    message: `with the robot '${robot}', 12 of 12 observations keep the targets on one place of the flange`,
    remedy: `check which robot was measured; if it is '${robot}', choose it`,
    action: { ...empty, kind: "choose_robot" as const, robot },
  });
  const assessment = {
    verdict: "do_not_use" as const,
    reasons: ["FANUC R-2000iC/165F", "FANUC R-2000iC/210F"].map(fitting),
    notes: [],
    joints_identified: 0,
    joint_count: 6,
    headline: null,
    questions: [],
  };
  const context = { run: { id: "r" } } as RunContext;
  const root = await drawn(<VerdictCard assessment={assessment} context={context} />);
  expect([...root.querySelectorAll("button")].map((button) => button.textContent)).toEqual([
    "Choose another robot: FANUC R-2000iC/165F",
    "Choose another robot: FANUC R-2000iC/210F",
  ]);
});

it("says a reason of the run on the run alone, and leads there", async () => {
  const reason = (code: "base_bends" | "numbers_missing") => ({
    code,
    weight: "use_with_care" as const,
    where: null,
    observation: null,
    message: `${code} is so`,
    remedy: `Mend ${code}`,
    action: null,
  });
  const assessment = {
    verdict: "use_with_care" as const,
    reasons: [reason("base_bends"), reason("numbers_missing")],
    notes: [],
    joints_identified: 6,
    joint_count: 6,
    headline: "Use this map with care: 1 reason of its run",
    questions: [],
  };
  const run = { id: "r", result: { assessment: { reasons: [reason("base_bends")] } } } as unknown as Run;
  const root = await drawn(<VerdictCard assessment={assessment} context={null} of={run} />);
  expect(root.textContent).not.toContain("base_bends");
  expect(root.textContent).toContain("Mend numbers_missing");
  expect(root.querySelector("a[href='#/runs/r']")?.textContent).toBe("Show the reason on the run");
});

it("asks for the payload of the robot, and offers no button before it is stated", async () => {
  const empty = { observations: [], joints: [], joint_map: [], offset: [], target: null, causes: [], unit: null };
  const reason = {
    code: "payload_not_stated",
    weight: "use",
    where: null,
    observation: null,
    message: "the robot states no payload",
    remedy: "state payload",
    action: { ...empty, kind: "state_payload", payload: null },
  };
  const assessment = {
    verdict: "use",
    reasons: [],
    questions: [reason],
    notes: [],
    headline: null,
  } as unknown as Assessment;
  const context = { run: { id: "r" } as Run } as RunContext;
  const root = await drawn(<VerdictCard assessment={assessment} context={context} />);
  const button = root.querySelector<HTMLButtonElement>("ul > li .actions button");
  expect([button?.textContent, button?.disabled]).toEqual(["Keep the payload with the robot, and repeat", true]);
});
