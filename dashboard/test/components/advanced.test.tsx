// @vitest-environment happy-dom
import { describe, expect, it, vi } from "vitest";
import type { Problem } from "../../src/api/types";
import { Advanced, useRunForm } from "../../src/features/readings/flow";
import { FormProblem } from "../../src/components/fields";
import { jsonOf } from "../../src/lib/json";
import { DhEditor } from "../../src/features/robots/new";
import { drawn, press, settled } from "./drawn";

const NUMBER = { type: "number" };
const LENGTH = { type: "number", unit: "m" };
const LIMIT = { type: "number", unit: "rad", unit_of_prismatic: "m" };
const MAYBE = { anyOf: [NUMBER, { type: "null" }] };
const SCHEMAS = {
  RunRequest: {
    properties: {
      confidence: {
        type: "number",
        default: 0.95,
        description: "Confidence. Level of the intervals. It is less than 1.",
      },
      stiffness_bounds: {
        type: "object",
        additionalProperties: { type: "array", prefixItems: [MAYBE, MAYBE] },
        unit: "N.m/rad",
      },
      stiffness_order: { type: "array", items: { type: "array", items: { type: "string" } } },
      resampling: { anyOf: [{ properties: { size: { type: "integer" } } }, { type: "null" }] },
    },
  },
  Noise: { properties: { sigma: { type: "number" } } },
  DhModel: { properties: { rows: { type: "array", items: { $ref: "#/DhRow" } } } },
  DhRow: { properties: { a: LENGTH, upper: LIMIT, kind: { type: "string", enum: ["revolute", "prismatic"] } } },
};
vi.stubGlobal("fetch", async () => new Response(JSON.stringify({ components: { schemas: SCHEMAS } })));

let request: Record<string, unknown> = {};

function Form({ problem = null }: { problem?: Problem | null }) {
  const form = useRunForm("file.json");
  request = form.request("s");
  return (
    <FormProblem.Provider value={problem}>
      <Advanced form={form} joints={["joint_1", "joint_2"]} />
    </FormProblem.Provider>
  );
}

const boxOf = (root: HTMLElement, label: string) => {
  const [named] = [...root.querySelectorAll("label")].filter(({ textContent }) => textContent?.startsWith(label));
  const box = root.querySelector<HTMLInputElement>(`[aria-label="${label}"], [id="${named?.htmlFor}"]`);
  if (!box) throw new Error(`no field ${label} in ${root.innerHTML}`);
  return box;
};

const typed = (root: HTMLElement, label: string, value: string) =>
  settled(() => {
    const box = boxOf(root, label);
    box.value = value;
    box.dispatchEvent(new Event(box.tagName === "SELECT" ? "change" : "input", { bubbles: true }));
  });

const opened = async (root: HTMLElement) => {
  await settled(() => {
    const details = root.querySelector("details") as HTMLDetailsElement;
    details.open = true;
    details.dispatchEvent(new Event("toggle"));
  });
  await settled(() => {});
  return root;
};

describe("advanced settings", () => {
  it("collects bounds and orders by joint, in the units of the page", async () => {
    const root = await opened(await drawn(<Form />));
    await typed(root, "Minimum, joint_2", "1.5");
    await typed(root, "Order", "joint_1 joint_2");
    expect(request).toEqual({
      measurement_set_id: "s",
      stiffness_bounds: { joint_2: [1.5e6, null] },
      stiffness_order: [["joint_1", "joint_2"]],
    });
    expect(root.querySelector("summary")?.textContent).toBe("Advanced stiffness bounds, stiffness order");
    await typed(root, "Minimum, joint_2", "");
    expect(request["stiffness_bounds"]).toEqual({});
  });

  it("says what is not understood, and lets the service name its field", async () => {
    const root = await opened(await drawn(<Form />));
    expect(boxOf(root, "Confidence").placeholder).toBe("0.95");
    expect(root.textContent).toContain("Level of the intervals.");
    expect(root.textContent).not.toContain("It is less than 1");
    await typed(root, "Confidence", "0.9x");
    expect(root.textContent).toContain("“0.9x” is not understood");
    expect(jsonOf(request)).toContain('"confidence":"0.9x"');
    await typed(root, "Confidence", "0,9");
    expect(request["confidence"]).toBe(0.9);
  });

  it("opens where the service found a fault, and says it at its field", async () => {
    const fault = { where: "stiffness_bounds.joint_2[0]", reason: "must be at least 1", remedy: null };
    const root = await drawn(
      <Form problem={{ detail: "", where: fault.where, errors: [fault] } as unknown as Problem} />,
    );
    await settled(() => {});
    expect(root.querySelector("details")?.open).toBe(true);
    const row = boxOf(root, "Minimum, joint_2").closest("tr");
    expect(row?.textContent).toContain("must be at least 1");
    expect(root.textContent?.split("must be at least 1")).toHaveLength(2);
  });
});

describe("a table of rows", () => {
  it("shows lengths in mm and limits by the kind of the joint, and grows", async () => {
    const rows = [
      { a: 0.35, upper: Math.PI / 2, kind: "revolute" },
      { a: null, upper: 0.18, kind: "prismatic" },
    ];
    const change = vi.fn();
    const root = await drawn(<DhEditor table={{ model: { rows }, map: null }} change={change} />);
    await settled(() => {});
    const shown = (label: string) => boxOf(root, label).value;
    expect([shown("a of joint 1"), shown("Upper of joint 1"), shown("Upper of joint 2")]).toEqual(["350", "90", "180"]);
    await typed(root, "a of joint 2", "120");
    expect(change.mock.lastCall?.[0].model.rows[1].a).toBe(0.12);
    await press(root, "Add a row");
    expect(change.mock.lastCall?.[0].model.rows).toHaveLength(3);
  });
});
