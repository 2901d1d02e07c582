// @vitest-environment happy-dom
import { expect, it } from "vitest";
import type { LastCampaign } from "../../src/api/types";
import { ChangedJoints } from "../../src/features/trend/changed";
import { drawn } from "./drawn";

it("separates the word from the joint that changed", async () => {
  const change = { value: 0.1, standard_uncertainty: 0.01 };
  const of = { serial_number: null, changed: [{ joint: "joint_2", serial_number: null, change }] };
  const root = await drawn(<ChangedJoints of={of as unknown as LastCampaign} />);
  expect(root.textContent).toContain("Changed joint_2 +10.0");
});
