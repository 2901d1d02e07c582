/** A Denavit-Hartenberg table to fill in, and the joint map for coupled axes. */
import type { DhModel, JointKind, JointMap as Map, RobotDocument } from "../api/types";
import { Button, Choice } from "../components/basics";
import { NumberBox, Select } from "../components/fields";
import { Scroll } from "../components/table";
import { numberIn } from "../lib/entered";
import { degrees, radians } from "../lib/units";
import { text } from "../i18n";
import { useCatalogue } from "./catalogue";

const CELLS = ["a", "alpha", "d", "theta", "lower", "upper"] as const;
type Column = (typeof CELLS)[number];
type Row = Record<Column, string> & { kind: JointKind };

/** The table as it is typed: text, so that "-" and "1." can stand while one types. */
export interface DhTable {
  convention: DhModel["convention"];
  length: "m" | "mm";
  angle: "rad" | "deg";
  rows: Row[];
  mapped: boolean;
  matrix: string[][];
  offset: string[];
}

const EMPTY: Row = { a: "", alpha: "", d: "", theta: "", lower: "", upper: "", kind: "revolute" };
const AXES = 6;

/** An empty table of a six-axis arm. */
export function newDh(): DhTable {
  const rows = Array.from({ length: AXES }, () => EMPTY);
  return resized({
    convention: "modified",
    length: "mm",
    angle: "deg",
    mapped: false,
    matrix: [],
    offset: [],
    rows,
  });
}

/** The table of a model, in millimetres and degrees. */
export function tableOf(model: DhModel, map: Map | null): DhTable {
  const length = (value: number) => typed(value * 1e3);
  const angle = (value: number | null | undefined) =>
    value === null || value === undefined ? "" : typed(degrees(value));
  const limit = (value: number | null | undefined, kind: JointKind = "revolute") =>
    kind === "prismatic" && typeof value === "number" ? length(value) : angle(value);
  return resized({
    ...newDh(),
    convention: model.convention,
    mapped: map !== null,
    matrix: map?.matrix.map((row) => row.map(typed)) ?? [],
    offset: map?.offset.map((value, i) => limit(value, model.rows[i]?.kind)) ?? [],
    rows: model.rows.map((row) => ({
      a: length(row.a),
      alpha: angle(row.alpha),
      d: length(row.d),
      theta: angle(row.theta),
      lower: limit(row.lower, row.kind),
      upper: limit(row.upper, row.kind),
      kind: row.kind,
    })),
  });
}

const typed = (value: number): string => String(Number(value.toFixed(9)));

/** The robot of a table, or null while something is no number, or no length is given. A blank cell is 0. */
export function documentOf(name: string, table: DhTable): RobotDocument | null {
  const unit = { a: table.length, d: table.length, alpha: table.angle, theta: table.angle };
  const si = (column: keyof typeof unit, typed: string) => {
    const value = numberIn(typed) ?? 0;
    return unit[column] === "mm" ? value / 1e3 : unit[column] === "deg" ? radians(value) : value;
  };
  const byKind = (typed: string, kind: JointKind = "revolute") => si(kind === "prismatic" ? "d" : "theta", typed);
  const limit = (typed: string, kind: JointKind) => (typed.trim() === "" ? null : byKind(typed, kind));
  const rows = table.rows.map((row) => ({
    a: si("a", row.a),
    alpha: si("alpha", row.alpha),
    d: si("d", row.d),
    theta: si("theta", row.theta),
    lower: limit(row.lower, row.kind),
    upper: limit(row.upper, row.kind),
    kind: row.kind,
  }));
  const matrix = table.matrix.map((line) => line.map((typed) => numberIn(typed) ?? NaN));
  const offset = table.offset.map((typed, i) => (typed.trim() === "" ? NaN : byKind(typed, table.rows[i]?.kind)));
  const numbers = [
    ...rows.flatMap(({ kind: _, ...row }) => Object.values(row)),
    ...(table.mapped ? [...matrix.flat(), ...offset] : []),
  ];
  if (numbers.some(Number.isNaN) || rows.every((row) => row.a === 0 && row.d === 0)) return null;
  return {
    name,
    model: { format: "dh", convention: table.convention, rows },
    joint_map: table.mapped ? { matrix, offset } : null,
  };
}

/** The joint map as large as the table: new joints stand for themselves. */
function resized(table: DhTable): DhTable {
  const index = table.rows.map((_, i) => i);
  return {
    ...table,
    matrix: index.map((i) => index.map((j) => table.matrix[i]?.[j] ?? (i === j ? "1" : "0"))),
    offset: index.map((i) => table.offset[i] ?? "0"),
  };
}

export function DhEditor({ table, change }: { table: DhTable; change: (table: DhTable) => void }) {
  const words = text.robots;
  const angleUnit = table.angle === "deg" ? "°" : "rad";
  const named = { ...words.column, lower: words.lower, upper: words.upper };
  const set = (part: Partial<DhTable>) => change({ ...table, ...part });
  const put = (i: number, column: Column, typed: string) =>
    set({ rows: table.rows.map((row, k) => (k === i ? { ...row, [column]: typed } : row)) });
  const putKind = (i: number, kind: JointKind) =>
    set({ rows: table.rows.map((row, k) => (k === i ? { ...row, kind } : row)) });
  const slides = table.rows.some(({ kind }) => kind === "prismatic");
  const unitOf = (column: Column) =>
    column === "a" || column === "d"
      ? table.length
      : slides && (column === "lower" || column === "upper")
        ? `${angleUnit}, ${table.length}`
        : angleUnit;
  return (
    <>
      <div class="row">
        <Choice
          label={words.convention}
          value={table.convention}
          change={(convention) => set({ convention })}
          options={(["modified", "standard"] as const).map((value) => ({
            value,
            label: words.conventions[value] ?? value,
          }))}
        />
        <Choice
          label={words.lengthUnit}
          value={table.length}
          change={(length) => set({ length })}
          options={{ mm: "mm", m: "m" }}
        />
        <Choice
          label={words.angleUnit}
          value={table.angle}
          change={(angle) => set({ angle })}
          options={{ deg: "°", rad: "rad" }}
        />
      </div>
      <h3>{words.rowsTitle}</h3>
      <Scroll label={words.rowsTitle}>
        <table class="inputs">
          <thead>
            <tr>
              <th scope="col" aria-label={text.run.joint} />
              <th scope="col">{words.kind}</th>
              {CELLS.map((column) => (
                <th scope="col">
                  {named[column]} <small>{unitOf(column)}</small>
                </th>
              ))}
            </tr>
          </thead>
          <tbody>
            {table.rows.map((row, i) => (
              <tr>
                <th scope="row">{i + 1}</th>
                <td>
                  <select
                    aria-label={words.cell(words.kind, i + 1)}
                    value={row.kind}
                    onChange={(event) => putKind(i, event.currentTarget.value as JointKind)}
                  >
                    {(["revolute", "prismatic"] as const).map((kind) => (
                      <option value={kind}>{words.kinds[kind]}</option>
                    ))}
                  </select>
                </td>
                {CELLS.map((column) => (
                  <td>
                    <NumberBox
                      aria-label={words.cell(named[column], i + 1)}
                      value={row[column]}
                      change={(typed) => put(i, column, typed)}
                      placeholder={column === "lower" || column === "upper" ? words.unknown : "0"}
                    />
                  </td>
                ))}
              </tr>
            ))}
          </tbody>
        </table>
      </Scroll>
      <div class="row">
        <Button
          disabled={table.rows.length >= 32}
          onClick={() => change(resized({ ...table, rows: [...table.rows, EMPTY] }))}
        >
          {words.addRow}
        </Button>
        <Button
          disabled={table.rows.length <= 1}
          onClick={() => change(resized({ ...table, rows: table.rows.slice(0, -1) }))}
        >
          {words.removeRow}
        </Button>
      </div>
      <details open={table.mapped} onToggle={(event) => set({ mapped: event.currentTarget.open })}>
        <summary>{words.jointMap}</summary>
        <p class="soft">{words.jointMapHint}</p>
        <Presets table={table} change={set} />
        <JointMap table={table} change={set} />
      </details>
    </>
  );
}

/** Joint maps that many controllers share; they fit tables of as many rows. */
function Presets({ table, change }: { table: DhTable; change: (part: Partial<DhTable>) => void }) {
  const words = text.robots;
  const catalogue = useCatalogue();
  const presets = catalogue.state === "ready" ? catalogue.value.joint_maps : [];
  const fitting = presets.filter((preset) => preset.joint_map.matrix.length === table.rows.length);
  const rows = (map: Map) => map.matrix.map((row) => row.map(typed));
  const current = fitting.find(
    ({ joint_map }) =>
      JSON.stringify(rows(joint_map)) === JSON.stringify(table.matrix) && table.offset.every((o) => numberIn(o) === 0),
  );
  if (fitting.length === 0) return null;
  return (
    <Select
      label={words.preset}
      value={current?.id ?? ""}
      change={(id) => {
        const chosen = fitting.find((preset) => preset.id === id);
        if (chosen) change({ matrix: rows(chosen.joint_map), offset: chosen.joint_map.offset.map(typed) });
      }}
      options={[{ value: "", label: words.presetNone }, ...fitting.map(({ id, name }) => ({ value: id, label: name }))]}
      {...(current ? { help: current.note } : {})}
    />
  );
}

function JointMap({ table, change }: { table: DhTable; change: (part: Partial<DhTable>) => void }) {
  const words = text.robots;
  const put = (i: number, j: number, typed: string) =>
    change({ matrix: table.matrix.map((line, k) => (k === i ? line.map((old, l) => (l === j ? typed : old)) : line)) });
  return (
    <Scroll label={words.jointMap}>
      <table class="inputs">
        <thead>
          <tr>
            <th scope="col" aria-label={text.run.joint} />
            {table.rows.map((_, j) => (
              <th scope="col">{j + 1}</th>
            ))}
            <th scope="col">{words.offset}</th>
          </tr>
        </thead>
        <tbody>
          {table.matrix.map((line, i) => (
            <tr>
              <th scope="row">{i + 1}</th>
              {line.map((typed, j) => (
                <td>
                  <NumberBox
                    aria-label={words.mapCell(i + 1, j + 1)}
                    aria-invalid={typed.trim() === ""}
                    value={typed}
                    change={(next) => put(i, j, next)}
                  />
                </td>
              ))}
              <td>
                <NumberBox
                  aria-label={words.offsetCell(i + 1)}
                  value={table.offset[i] ?? "0"}
                  change={(next) => change({ offset: table.offset.map((old, k) => (k === i ? next : old)) })}
                />
              </td>
            </tr>
          ))}
        </tbody>
      </table>
    </Scroll>
  );
}
