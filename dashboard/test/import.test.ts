import { describe, expect, it } from "vitest";
import type { ImportOptions } from "../src/api/types";
import {
  cellOf,
  dimensionOf,
  type FilePreview,
  type ImportFault,
  meaningsFor,
  withMeaning,
  withoutColumns,
  widthOf,
  fits,
  templateIn,
  templatesIn,
  withTemplate,
} from "../src/features/readings/imports";
import { sent, withStated } from "../src/features/readings/import";

const column = (number: number, header: string, meaning: string, unit: string | null = null) => ({
  column: number,
  header,
  meaning,
  unit,
  guessed: false,
});

const preview = {
  file: "day.csv",
  columns: [column(1, "label", "name"), column(2, "A1", "unknown"), column(3, "P10 x", "P10 loaded x", "mm")],
  header_lines: [2],
  first_lines: [3, 4],
  fault_rows: [],
  fault_lines: [],
} as unknown as FilePreview;

const fault = (part: Partial<ImportFault>): ImportFault => ({
  file: "day.csv",
  line: null,
  column: null,
  reason: "r",
  remedy: "m",
  option: null,
  words: [],
  ...part,
});

describe("columns", () => {
  it("have the dimension of what they mean", () => {
    const meanings = [
      "joint 3",
      "force x",
      "moment z",
      "load point y",
      "P10 loaded x",
      "position z",
      "name",
      "ignored",
    ];
    expect(meanings.map(dimensionOf)).toEqual(["angle", "force", "moment", "length", "length", "length", null, null]);
  });

  it("can mean any part of a campaign, known targets and one more", () => {
    const groups = meaningsFor([preview], ["P10"]);
    expect(groups.map((group) => group.name)).toEqual(["", "", "", "P10", "T1", ""]);
    expect(groups.flatMap((group) => group.meanings)).toContain("P10 deflection z");
  });

  it("are named by their header, and by their place where there is none", () => {
    expect(withMeaning({ columns: { B: "joint 2" } }, preview, 1, "joint 1")).toEqual({
      columns: { B: "joint 2", A1: "joint 1" },
    });
    expect(withMeaning({}, preview, 1, "ignored")).toEqual({ columns: { A1: "ignore" } });
    const given = { header: ["name", "ignore", "P10 loaded x"] };
    expect(withMeaning(given, preview, 1, "joint 1")).toEqual({ header: ["name", "joint 1", "P10 loaded x"] });
    const bare = { ...preview, columns: preview.columns.map((one) => ({ ...one, header: "" })) };
    expect(withMeaning({}, bare, 1, "joint 1")).toEqual({ header: ["name", "joint 1", "P10 loaded x"] });
  });

  it("are left out together", () => {
    expect(withoutColumns({}, preview, preview.columns.slice(1))).toEqual({
      columns: { A1: "ignore", "P10 x": "ignore" },
    });
  });

  it("show faults in the cells that are shown", () => {
    const places = [fault({ column: 2 }), fault({ line: 2, column: 2 }), fault({ line: 4, column: 3 })];
    expect(places.map((one) => cellOf(preview, one, [3, 4]))).toEqual(["0:2", "0:2", "4:3"]);
    expect(cellOf(preview, fault({ line: 9, column: 3 }), [3, 4])).toBeNull();
    expect(cellOf(preview, fault({ line: 9, column: 3 }), [3, 4, 9])).toBe("9:3");
    expect(cellOf(preview, fault({ line: 4 }), [3, 4])).toBeNull();
  });
});

describe("the width of a table", () => {
  it("is that of its first row, past comments", () => {
    const texts = ["# a;b\n1;2,5;3", "1\t2;3", "1,2\n", "\n a  b c\n", ""];
    expect(texts.map(widthOf)).toEqual([3, 2, 2, 3, 0]);
  });
});

describe("what no file says", () => {
  it("is not sent before it is understood", () => {
    expect(sent({ columns: {}, load_point: { unread: "0, 1" } as never, encoders: null })).toEqual({ columns: {} });
  });
  it("is in mm and N, whatever the files have, and in the units of a template", () => {
    expect(withStated({ units: { length: "m" } }, { units: { length: "m" }, force: [0, 0, -1500] })).toEqual({
      units: { length: "m", force: "N" },
      force: [0, 0, -1500],
    });
    expect(withStated({}, { load_point: [0, 0, 120] })).toEqual({ load_point: [0, 0, 120], length_unit: "mm" });
    const template: ImportOptions = {
      load_point: [0, 0, 0.12],
      force: [0, 0, -1.5],
      units: { length: "m", force: "kN" },
    };
    expect(withStated(template, { ...template })).toEqual({ ...template, length_unit: "m" });
  });
});

describe("templates", () => {
  const template = { name: "day.csv", options: { layouts: [["label", "A1", "P10 x"]], encoders: "motor" as const } };
  const answer = (files: FilePreview[]) => ({ files });

  it("fit files of the same headers", () => {
    expect(fits(template, answer([preview, preview]))).toBe(true);
    expect(fits(template, answer([{ ...preview, columns: preview.columns.slice(1) }]))).toBe(false);
    expect(fits({ name: "x", options: {} }, answer([preview]))).toBe(false);
  });

  it("are kept once for the same headers, the newest first", () => {
    const other = { name: "other.csv", options: { layouts: [["q"]] } };
    expect(withTemplate([other, template], { ...template, name: "newer.csv" }).map((one) => one.name)).toEqual([
      "newer.csv",
      "other.csv",
    ]);
    expect(templatesIn([template, 3, null])).toEqual([template]);
    expect(["", {}, 3, null].map(templatesIn)).toEqual([[], [], [], []]);
  });

  it("are told from campaigns", () => {
    expect(templateIn("t.json", JSON.stringify(template.options))).toEqual({
      name: "t.json",
      options: template.options,
    });
    for (const other of ["{}", "[]", "no", '{"units": {}, "observations": []}', '{"robot": {}, "columns": {}}'])
      expect(templateIn("t.json", other)).toBeNull();
  });
});

describe("a template's noise", () => {
  it("keeps its unit beside a load point that is stated", () => {
    const template = { units: { length: "m" }, noise: { sigma: 2e-5 } } as ImportOptions;
    expect(withStated(template, { ...template, load_point: [0, 0, 0.12] })).toMatchObject({ length_unit: "m" });
  });
});
