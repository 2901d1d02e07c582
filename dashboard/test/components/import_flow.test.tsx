// @vitest-environment happy-dom
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { ImportFlow } from "../../src/features/readings/import";
import { answering, drawn, settled } from "./drawn";

const column = (number: number, header: string, meaning: string, unit: string | null = null) => ({
  column: number,
  header,
  meaning,
  unit,
  guessed: header === "theta2_deg",
});

/** What the service would say: encoders are missing until they are stated, a column until it is named. */
function answerTo(options: Record<string, unknown>) {
  const named = "Achsw" in ((options["columns"] as object | undefined) ?? {});
  return {
    files: [
      {
        file: "day.csv",
        format: "text",
        sheet: null,
        encoding: "utf-8",
        delimiter: "semicolon",
        decimal_mark: "point",
        columns: [
          column(1, "label", "name"),
          column(2, "Achsw", named ? "joint 1" : "unknown", named ? "deg" : null),
          column(3, "theta2_deg", "joint 2", "deg"),
        ],
        row_count: 9,
        first_rows: [["c01", "12.5", "3"]],
        assumptions: ["2 rows above the header were taken for titles"],
        header_lines: [3],
        first_lines: [4],
        fault_rows: [["c03", "4", "1.2.3"]],
        fault_lines: [6],
      },
    ],
    targets: [],
    joint_count: null,
    assumptions: [],
    faults: [
      ...(named
        ? []
        : [{ file: "day.csv", line: 3, column: 2, reason: "unknown", remedy: "say it", option: "columns" }]),
      { file: "day.csv", line: 6, column: 3, reason: "'1.2.3' is no number", remedy: "correct it", option: null },
      ...(stateless
        ? [{ file: "day.csv", line: null, column: null, reason: "no state", remedy: "say it", option: "state" }]
        : []),
      { file: "plan.pdf", line: null, column: null, reason: "a PDF document", remedy: "export it", option: null },
    ],
    bodies: [],
    proposal: proposed,
    missing_fields: [...(options["encoders"] ? [] : ["encoders"]), ...(forceless ? ["force"] : [])],
    missing: [],
    findings: null,
    template: null,
    measurement_set: null,
  };
}

const proposal = "columns 1–6 as J1…J6 [deg] and 7–9 as T1 [mm] fit the arm to 0.4 mm.";
let proposed: string | null = null;
let stateless = false;
let forceless = false;
const asked: { method: string; path: string; options: Record<string, unknown> }[] = [];

beforeEach(() => {
  asked.length = 0;
  proposed = null;
  stateless = false;
  forceless = false;
  answering(({ method, path, body }) => {
    asked.push({ method, path, options: body ?? {} });
    const schemas = { ImportRequest: { properties: { encoders: { enum: ["motor", "secondary"] } } } };
    return path === "/v1/imports" ? answerTo(body ?? {}) : { items: [], next: null, components: { schemas } };
  });
});
afterEach(() => vi.unstubAllGlobals());

const content = "# t\n# t\nlabel;Achsw;theta2_deg\nc01;12.5;3\nc02;1;2\nc03;4;1.2.3\n";
const opened = {
  kind: "tables" as const,
  files: [new File([content], "day.csv"), new File(["%PDF"], "plan.pdf")],
  template: null,
};

const flow = () =>
  drawn(<ImportFlow opened={{ ...opened, files: [...opened.files] }} robot="" take={() => undefined} />);
const wait = () => settled(() => undefined).then(() => new Promise((done) => setTimeout(done, 350)));
const last = () => asked.filter(({ path }) => path === "/v1/imports").at(-1)?.options;

describe("tables of readings", () => {
  it("show faults in their cells, with rows further down, and by file where no cell is theirs", async () => {
    const root = await flow();
    await wait();
    await settled(() => undefined);
    const faulty = [...root.querySelectorAll(".faulty")].map((cell) => cell.textContent);
    expect(faulty[0]).toContain("Choose the meaning of this column");
    expect(faulty[1]).toBe("1.2.3'1.2.3' is no number: correct it");
    expect(root.querySelector("tr.further th")?.textContent).toBe("6");
    expect(root.querySelector(".warnings")?.textContent).toContain("plan.pdf: a PDF document");
    expect(root.querySelector(".guessed")?.textContent).toContain("theta2_deg");
  });

  it("are read again with the meaning that is chosen, and nothing is posted elsewhere", async () => {
    const root = await flow();
    await wait();
    const select = root.querySelector<HTMLSelectElement>("[aria-label='Meaning of Achsw']");
    expect(select?.value).toBe("unknown");
    await settled(() => {
      if (select) select.value = "joint 1";
      select?.dispatchEvent(new Event("change", { bubbles: true }));
    });
    await wait();
    expect(last()).toMatchObject({ columns: { Achsw: "joint 1" }, show_faults: true });
    expect(root.querySelectorAll("th.faulty")).toHaveLength(0);
    const posted = asked.filter(({ method }) => method !== "GET").map(({ path }) => path);
    expect(new Set(posted)).toEqual(new Set(["/v1/imports"]));
  });

  it("without the word unloaded are unloaded by one tap", async () => {
    stateless = true;
    const root = await flow();
    await wait();
    await settled(() => root.querySelector<HTMLInputElement>("input[value=unloaded]")?.click());
    await wait();
    expect(last()).toMatchObject({ state: "unloaded" });
  });

  it("are read as the robot proposes by one tap, and by their names again by another one", async () => {
    proposed = proposal;
    const root = await flow();
    await wait();
    const tap = (label: string) =>
      settled(() => [...root.querySelectorAll("button")].find((each) => each.textContent === label)?.click());
    expect(root.textContent).toContain(proposal);
    await tap("Take it");
    await wait();
    expect(last()).toMatchObject({ accept_proposal: true });
    await tap("Read by the names of the columns");
    await wait();
    expect(last()).toMatchObject({ accept_proposal: false });
  });

  it("show what is understood of a mass that may be read in two ways, and that some text is no mass", async () => {
    forceless = true;
    const root = await flow();
    await wait();
    const label = [...root.querySelectorAll("label")].find(
      (each) => each.textContent === "Or the mass of the hung weight [kg]",
    );
    const box = root.querySelector<HTMLInputElement>(`[id="${label?.htmlFor}"]`);
    const type = (typed: string) =>
      settled(() => {
        if (box) box.value = typed;
        box?.dispatchEvent(new Event("input", { bubbles: true }));
      });
    const said = () => box?.closest(".field")?.querySelector("small")?.textContent;
    await type("1.500");
    expect(said()).toBe("Understood as 1.5 kg");
    await type("150");
    expect(said()).not.toContain("nderstood");
    await type("1 x");
    expect(said()).toContain("“1 x” is not understood");
  });

  it("ask for what no file says", async () => {
    const root = await flow();
    await wait();
    await settled(() => root.querySelector<HTMLInputElement>("input[value=secondary]")?.click());
    await wait();
    expect(last()).toMatchObject({ encoders: "secondary" });
    expect(root.querySelector<HTMLButtonElement>(".button.big")?.disabled).toBe(true);
  });
});
