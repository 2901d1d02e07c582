/** A Denavit-Hartenberg table to fill in, and the joint map for coupled axes. */
import type { JointMap, RobotDocument } from "../api/types";
import { Select } from "../components/fields";
import { SchemaFields, type Terms } from "../components/schema_form";
import { type Fields, unreadIn } from "../lib/json";
import { later } from "../i18n/later";
import { useCatalogue } from "./catalogue";

const words = later.robots;

/** Model and joint map as they are typed, in SI; a map of null is none. */
export interface DhTable {
  model: Fields;
  map: Fields | null;
}

const EMPTY = { kind: "revolute" };
const AXES = 6;

/** An empty table of a six-axis arm. */
export const newDh = (): DhTable => ({
  model: { format: "dh", convention: "modified", rows: Array.from({ length: AXES }, () => EMPTY) },
  map: null,
});

const rowsOf = ({ model }: DhTable): Fields[] => model["rows"] as Fields[];

/** The robot of a table, or null while something is no number, or no length is given. A blank cell is 0. */
export function documentOf(name: string, table: DhTable): RobotDocument | null {
  const rows = rowsOf(table).map((row) => ({ ...row, ...filled(row) }));
  if (unreadIn(table) !== null || rows.every(({ a, d }) => a === 0 && d === 0)) return null;
  return { name, model: { ...table.model, rows }, joint_map: table.map } as unknown as RobotDocument;
}

const filled = ({ a, alpha, d, theta }: Fields) => ({ a: a ?? 0, alpha: alpha ?? 0, d: d ?? 0, theta: theta ?? 0 });

/** A joint map as large as the table: joints stand for themselves. */
const identity = (count: number): Fields => ({
  matrix: Array.from({ length: count }, (_, i) => Array.from({ length: count }, (_, j) => (i === j ? 1 : 0))),
  offset: Array.from({ length: count }, () => 0),
});

export function DhEditor({ table, change }: { table: DhTable; change: (table: DhTable) => void }) {
  const rows = rowsOf(table);
  const slides = rows.some(({ kind }) => kind === "prismatic");
  const terms: Terms = {
    labels: {
      rows: words.rowsTitle,
      ...Object.fromEntries(Object.entries(words.column).map(([name, shown]) => [`rows.${name}`, shown])),
    },
    seeds: { rows: EMPTY },
    units: slides ? { offset: ["rad, m", 1] } : {},
  };
  return (
    <>
      <SchemaFields
        of="DhModel-Input"
        show={["convention", "rows"]}
        value={table.model}
        change={(model) => change({ ...table, model })}
        terms={terms}
      />
      <details
        open={table.map !== null}
        onToggle={({ currentTarget: { open } }) => {
          if (open !== (table.map !== null)) change({ ...table, map: open ? identity(rows.length) : null });
        }}
      >
        <summary>{words.jointMap}</summary>
        <p class="soft">{words.jointMapHint}</p>
        {table.map && (
          <>
            <Presets map={table.map} count={rows.length} change={(map) => change({ ...table, map })} />
            <SchemaFields
              of="JointMap"
              show={["matrix", "offset"]}
              value={table.map}
              change={(map) => change({ ...table, map })}
              terms={terms}
            />
          </>
        )}
      </details>
    </>
  );
}

/** Joint maps that many controllers share; they fit tables of as many rows. */
function Presets({ map, count, change }: { map: Fields; count: number; change: (map: Fields) => void }) {
  const catalogue = useCatalogue();
  const presets = catalogue.state === "ready" ? catalogue.value.joint_maps : [];
  const fitting = presets.filter((preset) => preset.joint_map.matrix.length === count);
  const same = (one: JointMap) => JSON.stringify(one.matrix) === JSON.stringify(map["matrix"]);
  const current = fitting.find(({ joint_map: one }) => same(one) && (map["offset"] as number[]).every((o) => o === 0));
  if (fitting.length === 0) return null;
  return (
    <Select
      label={words.preset}
      value={current?.id ?? ""}
      change={(id) => {
        const chosen = fitting.find((preset) => preset.id === id);
        if (chosen) change({ ...chosen.joint_map });
      }}
      options={[{ value: "", label: words.presetNone }, ...fitting.map(({ id, name }) => ({ value: id, label: name }))]}
      {...(current ? { help: current.note } : {})}
    />
  );
}
