// @vitest-environment happy-dom
import { describe, expect, it } from "vitest";
import type { Problem } from "../../src/api/types";
import { Advanced, useRunForm } from "../../src/views/advanced";
import { FormProblem } from "../../src/components/fields";
import { drawn, press, settled } from "./drawn";

let request: Record<string, unknown> = {};

function Form({ problem = null }: { problem?: Problem | null }) {
  const form = useRunForm();
  request = form.request("s");
  return (
    <FormProblem.Provider value={problem}>
      <Advanced form={form} facts={null} joints={["joint_1", "joint_2"]} />
    </FormProblem.Provider>
  );
}

const typed = (root: HTMLElement, label: string, value: string) =>
  settled(() => {
    const box = root.querySelector<HTMLInputElement>(`[aria-label="${label}"]`);
    if (!box) throw new Error(`no field ${label}`);
    box.value = value;
    box.dispatchEvent(new Event(box.tagName === "SELECT" ? "change" : "input", { bubbles: true }));
  });

describe("advanced settings", () => {
  it("collects bounds and orders by joint", async () => {
    const root = await drawn(<Form />);
    await typed(root, "Minimum, joint_2", "1.5");
    await press(root, "Add an order");
    await typed(root, "Stiffer joint", "joint_1");
    await typed(root, "Softer joint", "joint_2");
    expect(request).toEqual({
      measurement_set_id: "s",
      stiffness_bounds: { joint_2: [1.5e6, null] },
      stiffness_order: [["joint_1", "joint_2"]],
    });
    expect(root.querySelector("summary")?.textContent).toBe("Advanced stiffness bounds, stiffness order");
  });

  it("opens where the service found a fault, and says it at its field", async () => {
    const fault = { where: "stiffness_bounds.joint_2[0]", reason: "must be at least 1", remedy: null };
    const root = await drawn(
      <Form problem={{ detail: "", where: fault.where, errors: [fault] } as unknown as Problem} />,
    );
    expect(root.querySelector("details")?.open).toBe(true);
    const row = root.querySelector("[aria-label='Minimum, joint_2']")?.closest("tr");
    expect(row?.textContent).toContain("must be at least 1");
    expect(root.textContent?.split("must be at least 1")).toHaveLength(2);
  });
});
