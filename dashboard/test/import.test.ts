import { describe, expect, it } from "vitest";
import type { Mapping, TableMapping } from "../src/api/types";
import * as roles from "../src/features/readings/mapping";
import { open } from "../src/features/readings/opening";

const column = (id: string) => ({ id, header: "", cells: [1, 2], role: "" });
const table: roles.Table = { name: "day 1.csv", row_count: 9, columns: [..."ABCDEFGHIJKLM"].map(column) };
const part = (...named: TableMapping["roles"]) => ({ table: ["day*.csv"], roles: named }) as TableMapping;
const joints = { columns: "B:G", role: "joints", unit: "deg" } as const;
const unloaded = { columns: "H:J", role: "position", target: "T1", state: "unloaded", unit: "mm" } as const;
const mapping: Mapping = { encoders: "motor", tables: [part({ columns: "A", role: "label" }, joints, unloaded)] };

describe("the columns of a role", () => {
  it("are those of a spreadsheet, in the order of the role", () => {
    const columns = (text: string) => roles.columnsOf({ columns: text, role: "joints" }, table).join("");
    expect(["B", "B:D", "D:B", "B,D,F", " b : c "].map(columns)).toEqual(["B", "BCD", "DCB", "BDF", "BC"]);
  });

  it("are one group side by side, and columns without a role are groups of their own", () => {
    const groups = roles.groupsOf(mapping, table);
    expect(groups.map((group) => [group.role?.role, group.columns.length])).toEqual([
      ["label", 1],
      ["joints", 6],
      ["position", 3],
      ...[1, 2, 3].map(() => [undefined, 1]),
    ]);
  });
});

describe("an edited role", () => {
  const rolesAfter = (...edit: [string[], roles.Meaning | null]) =>
    roles.withRole(mapping, table, ...edit).tables?.[0]?.roles.map((role) => `${role.role} ${role.columns}`);

  it("takes its columns from other roles, in their place, and leaves the rest of the mapping", () => {
    expect(rolesAfter([..."BCDEFG"], { ...joints, unit: "rad" })).toEqual(["label A", "joints B:G", "position H:J"]);
    expect(rolesAfter(["G"], null)).toEqual(["label A", "joints B:F", "position H:J"]);
    expect(rolesAfter([..."KLM"], { role: "position" })?.at(-1)).toBe("position K:M");
    expect(roles.withRole(mapping, table, ["G"], null)).toMatchObject({ encoders: "motor" });
  });

  it("begins the part of a table that no mapping names", () => {
    const other = { ...table, name: "points (2).txt" };
    const { tables } = roles.withRole(mapping, other, [..."CBA"], { role: "position" });
    expect(tables?.[1]).toMatchObject({ table: ["points (2).txt"], roles: [{ columns: "C:A", role: "position" }] });
  });

  it("has the usual unit, and the first state that no column has yet", () => {
    expect(roles.usualMeaning("joints", mapping, table)).toEqual({ role: "joints", unit: "deg" });
    const second = roles.usualMeaning("position", mapping, table);
    expect(second).toEqual({ role: "position", unit: "mm", target: "T1", state: "loaded" });
    const complete = roles.withRole(mapping, table, [..."KLM"], second);
    expect(roles.usualMeaning("position", complete, table)).toMatchObject({ target: "T2", state: "unloaded" });
    const inRows: Mapping = { tables: [part({ columns: "A", role: "state" })] };
    expect(roles.usualMeaning("position", inRows, table)).toEqual({ role: "position", unit: "mm" });
  });

  it("gets as many free columns as it needs by a tap on the first, and never one that is in use", () => {
    const groups = roles.groupsOf(mapping, table);
    const columns = (role: roles.RoleName, at: number) =>
      roles.columnsFor(role, groups[at] as roles.Group, mapping, table, 6).join("");
    expect(columns("position", 3)).toBe("KLM");
    expect(columns("mass", 3)).toBe("K");
    expect(columns("position", 1)).toBe("BCDEFG");
    expect(columns("joints", 3)).toBe("KLM");
  });
});

describe("dropped files", () => {
  const file = (name: string, content: unknown) =>
    new File([typeof content === "string" ? content : JSON.stringify(content)], name);
  const csv = file("day 1.csv", "1;2;3");

  it("are read by a mapping that comes with them, before or after them", async () => {
    const saved = file("day.mapping.json", mapping);
    expect(await open([csv, saved], null)).toEqual({ kind: "tables", files: [csv], mapping });
    const alone = await open([saved], null);
    expect(alone).toMatchObject({ kind: "mapping", mapping });
    expect(await open([csv], alone)).toEqual({ kind: "tables", files: [csv], mapping });
    expect(await open([saved], { kind: "tables", files: [csv], mapping: null })).toMatchObject({
      files: [csv],
      mapping,
    });
  });

  it("are tables if their JSON is none of our documents, or is wrong", async () => {
    for (const content of [[{ q: [1, 2] }], { joints: [[1, 2]] }, '{"a": 1, }']) {
      const log = file("log.json", content);
      expect(await open([log], null)).toEqual({ kind: "tables", files: [log], mapping: null });
    }
    expect(roles.mappingIn('{"tables": [[1, 2]]}')).toBeNull();
    expect(roles.mappingIn("{}")).toBeNull();
  });

  it("are a campaign alone", async () => {
    const campaign = file("campaign.json", { measurement_set: { observations: [] } });
    expect(await open([campaign], null)).toMatchObject({ kind: "campaign" });
    expect(await open([campaign, csv], null)).toMatchObject({ fault: "mixed" });
    expect(await open([campaign, campaign], null)).toMatchObject({ fault: "several" });
  });
});
