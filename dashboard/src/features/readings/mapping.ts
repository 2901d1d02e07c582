/** Mappings of tables: the columns that a role names, and a mapping after an edit of a role. */
import type { ImportAnswer, Mapping, Role, TableMapping } from "../../api/types";
import { isFields, parsed } from "../../lib/json";

export type Table = ImportAnswer["tables"][number];
type Column = Table["columns"][number];
export type RoleName = Role["role"];
/** What a role says apart from its columns. */
export type Meaning = Omit<Role, "columns">;

/** Columns side by side that have one role; a column without a role is a group of its own. */
export interface Group {
  role: Role | null;
  columns: Column[];
}

/** Units of the roles that have one, the usual unit first. */
export const UNITS: Partial<Record<RoleName, NonNullable<Role["unit"]>[]>> = {
  joints: ["deg", "rad", "mm", "m"],
  position: ["mm", "m", "cm", "in"],
  displacement: ["mm", "µm", "m", "in"],
  value: ["mm", "m", "cm", "in"],
  uncertainty: ["mm", "µm", "m"],
  force: ["N", "daN", "kN", "kgf", "lbf"],
  load: ["N", "daN", "kN", "kgf", "lbf", "kg"],
  mass: ["kg", "N", "kgf", "lbf"],
  moment: ["N.m", "N.mm", "kN.m"],
};

const VECTORS: RoleName[] = ["position", "displacement", "force", "moment", "uncertainty"];

const idsOf = (table: Table): string[] => table.columns.map(({ id }) => id);

/** The ids of the columns of a role: of `B:D` B, C, D, and of `D:B` D, C, B. */
export function columnsOf(role: Role, table: Table): string[] {
  const ids = idsOf(table);
  return role.columns.split(",").flatMap((part) => {
    const [first = "", last = first] = part.split(":").map((id) => id.trim().toUpperCase());
    const [start, end] = [ids.indexOf(first), ids.indexOf(last)];
    if (start < 0 || end < 0) return [part.trim()];
    return start <= end ? ids.slice(start, end + 1) : ids.slice(end, start + 1).reverse();
  });
}

/** Columns as a role has them: `B:G` if they follow each other, else `B,D,F`. */
function nameColumns(columns: readonly string[], table: Table): string {
  const [first = "", last = first] = [columns[0], columns.at(-1)];
  const range = `${first}:${last}`;
  const between = columnsOf({ columns: range, role: "ignore" }, table);
  return columns.length > 2 && between.join() === columns.join() ? range : columns.join(",");
}

/** The place of the part of a mapping that names a table; -1 for none. In a name `*` is any text. */
function findPart(mapping: Mapping, table: Table): number {
  const matches = (name: string) =>
    new RegExp(`^${name.replace(/[.+?^${}()|[\]\\]/g, "\\$&").replaceAll("*", ".*")}$`).test(table.name);
  return (mapping.tables ?? []).findIndex((part) => part.table.some(matches));
}

const rolesOf = (mapping: Mapping, table: Table): Role[] => mapping.tables?.[findPart(mapping, table)]?.roles ?? [];

/** The columns of a table, grouped by their roles. */
export function groupsOf(mapping: Mapping, table: Table): Group[] {
  const roles = rolesOf(mapping, table);
  const groups: Group[] = [];
  for (const column of table.columns) {
    const role = roles.find((each) => columnsOf(each, table).includes(column.id)) ?? null;
    const before = groups.at(-1);
    if (role !== null && before?.role === role) before.columns.push(column);
    else groups.push({ role, columns: [column] });
  }
  return groups;
}

/** The targets that a mapping names, in their order. */
export function targetsOf({ tables = [] }: Mapping): string[] {
  const names = tables.flatMap(({ roles, cycle = [] }) => [...roles, ...cycle]).map(({ target }) => target);
  return [...new Set(names)].filter((name) => name !== null && name !== undefined);
}

/** A mapping in which columns have a role alone; null takes their role away. */
export function withRole(mapping: Mapping, table: Table, columns: string[], meaning: Meaning | null): Mapping {
  const roles: Role[] = [];
  const added = meaning === null ? [] : [{ ...meaning, columns: nameColumns(columns, table) }];
  let isAdded = false;
  for (const role of rolesOf(mapping, table)) {
    const own = columnsOf(role, table);
    const rest = own.filter((id) => !columns.includes(id));
    if (rest.length === own.length) {
      roles.push(role);
      continue;
    }
    if (!isAdded) roles.push(...added); // in the place of the first role that it replaces
    isAdded = true;
    if (rest.length > 0) roles.push({ ...role, columns: nameColumns(rest, table) });
  }
  if (!isAdded) roles.push(...added);
  const at = findPart(mapping, table);
  const parts = [...(mapping.tables ?? [])];
  if (at < 0) parts.push({ table: [table.name], roles } as TableMapping);
  else parts[at] = { ...(parts[at] as TableMapping), roles };
  return { ...mapping, tables: parts };
}

/** What a role means before one says more: the usual unit, and the first state of a target that no column has yet. */
export function usualMeaning(role: RoleName, mapping: Mapping, table: Table): Meaning {
  const unit = UNITS[role]?.[0];
  const usual: Meaning = { role, ...(unit ? { unit } : {}) };
  const roles = rolesOf(mapping, table);
  const hasWords = roles.some((each) => ["target", "state", "point"].includes(each.role));
  if ((role !== "position" && role !== "displacement") || hasWords) return usual;
  const known = (mapping.tables ?? []).flatMap((part) => part.roles).filter((each) => each.role === role);
  for (let number = 0; ; number += 1) {
    const target = targetsOf(mapping)[number] ?? `T${number + 1}`;
    const states = known.filter((each) => each.target === target).map(({ state }) => state);
    if (role === "displacement" && states.length === 0) return { ...usual, target };
    const state = (["unloaded", "loaded"] as const).find((each) => !states.includes(each));
    if (role === "position" && state) return { ...usual, target, state };
  }
}

/** The columns that get a role by a tap on one of them: its group, or as many free columns as the role has. */
export function columnsFor(role: RoleName, group: Group, mapping: Mapping, table: Table, joints: number): string[] {
  const own = group.columns.map(({ id }) => id);
  if (group.role !== null) return own;
  const free = new Set(groupsOf(mapping, table).flatMap((each) => (each.role === null ? each.columns : [])));
  const count = role === "joints" ? joints : VECTORS.includes(role) ? 3 : 1;
  const begin = idsOf(table).indexOf(own[0] ?? "");
  const wanted = table.columns.slice(begin, begin + count);
  return wanted.every((column) => free.has(column)) ? wanted.map(({ id }) => id) : own;
}

/** The words in the first cells of a column and in its role, each of which may have a meaning. */
export function wordsOf({ role, columns: [column] }: Group): string[] {
  const cells = (column?.cells ?? []).filter((cell) => cell !== null).map(String);
  return [...new Set([...cells, ...Object.keys(role?.words ?? {})])];
}

const FIELDS = [
  "encoding",
  "encoders",
  "load_point",
  "load_point_target",
  "force",
  "flange_targets",
  "noise",
  "frame",
  "tables",
  "doubts",
] as const satisfies readonly (keyof Mapping)[];

/** The mapping in a JSON file; null if the file is something else. */
export function mappingIn(content: string): Mapping | null {
  const document = parsed(content);
  if (!isFields(document)) return null;
  const names = Object.keys(document);
  const known: readonly string[] = FIELDS;
  const parts = document["tables"] ?? [];
  const areParts = Array.isArray(parts) && parts.every((part) => isFields(part) && Array.isArray(part["roles"]));
  return names.length > 0 && names.every((name) => known.includes(name)) && areParts ? (document as Mapping) : null;
}
