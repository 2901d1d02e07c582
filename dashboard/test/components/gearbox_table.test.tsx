// @vitest-environment happy-dom
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { GearboxesView } from "../../src/features/gearbox/view";
import { answering, drawn, settled } from "./drawn";

const asked: { path: string; body: Record<string, unknown> | null }[] = [];
const reading = { joint: "joint_2", unloaded: { motor: 1, link: 1 }, loaded: { motor: 1, link: 2 }, approach: "+" };
const step = {
  units: { length: "mm", angle: "deg" },
  observations: [{ label: "s01", joints: [0, 1], encoder_readings: [reading] }],
};
const number = { type: "number" };
const schemas = {
  HungLoad: {
    properties: {
      mass: number,
      mass_uncertainty: number,
      point: { type: "array", prefixItems: [number, number, number], minItems: 3, maxItems: 3 },
      point_uncertainty: number,
    },
  },
};
const robot = { id: "a1", name: "arm", joints: [], created_at: "2026-01-01T00:00:00Z" };
let weight: typeof step | null = step;

beforeEach(() => {
  asked.length = 0;
  weight = step;
  answering(({ method, path, body }) => {
    if (method === "POST") asked.push({ path, body });
    if (path === "/v1/imports") return { weight_step: weight };
    if (path.startsWith("/v1/robots")) return { items: [robot], next: null };
    return { id: "g1", kind: "gearbox", items: [], next: null, components: { schemas } };
  });
});
afterEach(() => vi.unstubAllGlobals());

async function opened(): Promise<HTMLElement> {
  const root = await drawn(<GearboxesView query={new URLSearchParams()} />);
  const input = root.querySelector<HTMLInputElement>("input[type=file]");
  Object.defineProperty(input, "files", { value: [new File(["label,motor [deg]"], "step.csv")] });
  await settled(() => input?.dispatchEvent(new Event("change", { bubbles: true })));
  for (let i = 0; i < 5; i += 1) await settled(() => undefined);
  return root;
}

const button = (root: HTMLElement) =>
  [...root.querySelectorAll("button")].find((each) => each.textContent === "Identify the gearboxes");

it("reads a table by the service, and asks for its load before it can be identified", async () => {
  const root = await opened();
  expect(asked.map(({ path }) => path)).toEqual(["/v1/imports"]);
  expect(root.textContent).toContain("joint_2");
  expect(root.textContent).toContain("Mass of the load");
  expect(button(root)?.disabled).toBe(true);
});

it("names the columns that a table needs if it is no weight step", async () => {
  weight = null;
  const root = await opened();
  expect(root.textContent).toContain("A table needs “motor” and “link”");
  expect(button(root)).toBeUndefined();
});
