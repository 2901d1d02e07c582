// @vitest-environment happy-dom
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import type { Mapping } from "../../src/api/types";
import { ImportFlow } from "../../src/features/readings/import";
import { answering, drawn, press, settled } from "./drawn";

const column = (id: string, header: string) => ({ id, header, cells: [12.5, 3], role: "" });
const TABLE = { name: "day.csv", row_count: 9, columns: [..."ABCDEF"].map((id) => column(id, `head ${id}`)) };
const roles = [
  { columns: "A:C", role: "position", target: "T1", state: "unloaded", unit: "m" },
  { columns: "D:F", role: "position", target: "T1", state: "loaded", unit: "mm" },
];
const PROPOSED = { tables: [{ table: ["day.csv"], roles }], doubts: [{ about: "states", text: "right?" }] };

/** What the service would answer: a doubt, then the load point, then a set or a fault by the unit of A:C. */
function answerTo(mapping: Mapping) {
  const now = { ...PROPOSED, ...mapping };
  const doubt = { text: "which are under load?", field: null, choices: [] as unknown[] };
  doubt.choices = [{ text: "yes", mapping: { ...now, doubts: [] } }];
  const place = { text: "where does the load act?", field: "load_point", choices: [] };
  const isWrong = now.tables[0]?.roles.some(({ unit }) => unit === "m");
  const questions = [...(now.doubts.length > 0 ? [doubt] : []), ...(now.load_point ? [] : [place])];
  return {
    tables: [TABLE],
    mapping: now,
    sentence: "63 of 64 positions fit the robot to 0.5 mm",
    questions,
    faults: isWrong ? ["the robot is 900 mm away from the positions: look at the unit"] : [],
    far: isWrong ? [{ posture: "c03", target: "T1", state: "loaded", distance: 42.4 }] : [],
    findings: null,
    measurement_set: isWrong ? { units: {}, observations: [] } : null, // is not to be identified
    geometry: null,
    weight_step: steps ? { units: {}, observations: [] } : null,
  };
}

let away = false;
let steps = false;
const sent: Mapping[] = [];
const robot = { id: "r1", name: "press line", joints: [], created_at: "2026-07-01T08:00:00Z", last_campaign: null };
const VECTOR = { type: "array", prefixItems: [1, 2, 3].map(() => ({ type: "number" })) };
const schemas = { Mapping: { properties: { load_point: VECTOR, load_point_target: { type: "string" } } } };

beforeEach(() => {
  away = steps = false;
  sent.length = 0;
  answering(({ path, body }) => {
    if (path !== "/v1/imports") return { items: [robot], next: null, total: 1, components: { schemas } };
    if (away) throw new TypeError("Failed to fetch");
    sent.push((body?.["mapping"] ?? {}) as Mapping);
    return answerTo(sent.at(-1) as Mapping);
  });
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener: () => {}, removeEventListener: () => {} }));
});
afterEach(() => vi.unstubAllGlobals());

const opened = { kind: "tables" as const, files: [new File(["1;2"], "day.csv")], mapping: null };
const wait = () => settled(() => undefined).then(() => new Promise((done) => setTimeout(done, 350)));

async function flow() {
  const root = await drawn(<ImportFlow opened={{ ...opened }} robot="" take={() => undefined} />);
  await wait();
  await settled(() => undefined);
  return root;
}
const answered = async () => {
  await wait();
  await settled(() => undefined);
};
const button = (root: HTMLElement, words: string) =>
  [...root.querySelectorAll("button")].find(({ textContent }) => textContent?.includes(words)) as HTMLButtonElement;

describe("tables of readings", () => {
  it("have a role above each group of columns, the robot's sentence, faults and what lies far", async () => {
    const root = await flow();
    const heads = [...root.querySelectorAll("th[scope=colgroup]")].map(({ textContent }) => textContent);
    expect(heads).toEqual(["T1 unloaded [m] A – C", "T1 loaded [mm] D – F"]);
    expect(root.textContent).toContain("63 of 64 positions fit the robot to 0.5 mm");
    expect(root.querySelector("[role=alert]")?.textContent).toContain("look at the unit");
    expect(root.querySelector("[role=alert]")?.textContent).toContain("c03 T1 loaded: 42 mm from where");
    expect(button(root, "Identify").disabled).toBe(true);
  });

  it("have one question at a time: a choice sends its mapping, a box sends what is stated", async () => {
    const root = await flow();
    expect(root.textContent).not.toContain("Where does the load act");
    await press(root, "yes");
    await answered();
    expect(sent.at(-1)).toEqual({ ...PROPOSED, doubts: [] });
    const box = root.querySelector<HTMLTextAreaElement>(".ask textarea");
    await settled(() => {
      if (box) box.value = "0 0 120";
      box?.dispatchEvent(new Event("input", { bubbles: true }));
    });
    await settled(() => root.querySelector<HTMLFormElement>("form.ask")?.requestSubmit());
    await answered();
    expect(sent.at(-1)).toMatchObject({ doubts: [], load_point: [0, 0, 120] });
  });

  it("are checked again at once when a role is changed by a tap", async () => {
    const root = await flow();
    HTMLDialogElement.prototype.showModal = function open() {
      this.open = true;
    };
    await settled(() => button(root, "T1 unloaded [m]").click());
    const unit = root.querySelector<HTMLInputElement>("dialog input[value=mm]");
    await settled(() => unit?.click());
    await answered();
    expect(sent.at(-1)?.tables?.[0]?.roles[0]).toEqual({ ...roles[0], unit: "mm" });
    expect(root.querySelector("dialog .check")?.textContent).toContain("hich are under load");
    expect(root.querySelector("[role=alert]")).toBeNull();
  });

  it("stay in view with what was stated while the service is away", async () => {
    const root = await flow();
    away = true;
    await press(root, "yes");
    await answered();
    expect(root.textContent).toContain("The service is not available");
    expect(root.querySelectorAll("th[scope=colgroup]")).toHaveLength(2);
    expect(button(root, "Identify").disabled).toBe(true);
  });

  it("go on to the gearboxes if they are a weight step", async () => {
    steps = true;
    const root = await flow();
    await press(root, "Go on to the gearboxes");
    expect(location.hash).toBe("#/gearboxes");
  });
});
