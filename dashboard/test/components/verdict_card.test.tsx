// @vitest-environment happy-dom
import { expect, it } from "vitest";
import { VerdictCard } from "../../src/components/job_page";
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
  };
  const root = await drawn(<VerdictCard assessment={assessment} context={null} />);
  expect(root.querySelector("h2")?.textContent).toContain(said);
});
