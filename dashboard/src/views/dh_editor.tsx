/** A Denavit-Hartenberg table to fill in, and the joint map for coupled axes. */
import type { DhModel, RobotDocument } from "../api/types";
import { Choice } from "../components/basics";
import { Scroll } from "../components/table";
import { radians } from "../lib/units";
import { text } from "../i18n";

const COLUMNS = ["a", "alpha", "d", "theta"] as const;
type Column = (typeof COLUMNS)[number];
type Row = Record<Column, string>;

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

const EMPTY: Row = { a: "0", alpha: "0", d: "0", theta: "0" };

/** A six-axis arm to begin with: what is drawn is an arm, and its numbers are to be replaced. */
export function newDh(): DhTable {
  const rows: [number, number, number, number][] = [
    [0, 0, 675, 0],
    [350, -90, 0, -90],
    [1150, 0, 0, 0],
    [41, -90, 1200, 0],
    [0, 90, 0, 0],
    [0, -90, 215, 0],
  ];
  return resized({
    convention: "modified",
    length: "mm",
    angle: "deg",
    mapped: false,
    matrix: [],
    offset: [],
    rows: rows.map(([a, alpha, d, theta]) => ({
      a: String(a),
      alpha: String(alpha),
      d: String(d),
      theta: String(theta),
    })),
  });
}

/** A decimal comma is a point; what is not a number is none. */
export function numberOf(typed: string): number | null {
  const value = Number(typed.trim().replace(",", ".").replace("\u2212", "-"));
  return typed.trim() !== "" && Number.isFinite(value) ? value : null;
}

/** The robot of a table, or null while something is no number. */
export function documentOf(name: string, table: DhTable): RobotDocument | null {
  const unit = { a: table.length, d: table.length, alpha: table.angle, theta: table.angle };
  const si = (column: Column, typed: string) => {
    const value = numberOf(typed);
    return value === null ? NaN : unit[column] === "mm" ? value / 1e3 : unit[column] === "deg" ? radians(value) : value;
  };
  const rows = table.rows.map((row) => ({
    a: si("a", row.a),
    alpha: si("alpha", row.alpha),
    d: si("d", row.d),
    theta: si("theta", row.theta),
  }));
  const matrix = table.matrix.map((line) => line.map((typed) => numberOf(typed) ?? NaN));
  const offset = table.offset.map((typed) => si("theta", typed));
  const numbers = [
    ...rows.flatMap((row) => Object.values(row)),
    ...(table.mapped ? [...matrix.flat(), ...offset] : []),
  ];
  if (numbers.some(Number.isNaN)) return null;
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
  const set = (part: Partial<DhTable>) => change({ ...table, ...part });
  const put = (i: number, column: Column, typed: string) =>
    set({ rows: table.rows.map((row, k) => (k === i ? { ...row, [column]: typed } : row)) });
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
          options={[
            { value: "mm", label: "mm" },
            { value: "m", label: "m" },
          ]}
        />
        <Choice
          label={words.angleUnit}
          value={table.angle}
          change={(angle) => set({ angle })}
          options={[
            { value: "deg", label: "°" },
            { value: "rad", label: "rad" },
          ]}
        />
      </div>
      <h3>{words.rowsTitle}</h3>
      <Scroll label={words.rowsTitle}>
        <table class="inputs">
          <thead>
            <tr>
              <th scope="col" aria-label={text.run.joint} />
              {COLUMNS.map((column) => (
                <th scope="col">
                  {words.column[column]}{" "}
                  <small>{column === "a" || column === "d" ? table.length : table.angle === "deg" ? "°" : "rad"}</small>
                </th>
              ))}
            </tr>
          </thead>
          <tbody>
            {table.rows.map((row, i) => (
              <tr>
                <th scope="row">{i + 1}</th>
                {COLUMNS.map((column) => (
                  <td>
                    <NumberInput
                      label={words.cell(words.column[column] ?? column, i + 1)}
                      value={row[column]}
                      change={(typed) => put(i, column, typed)}
                    />
                  </td>
                ))}
              </tr>
            ))}
          </tbody>
        </table>
      </Scroll>
      <div class="row">
        <button
          type="button"
          class="button"
          disabled={table.rows.length >= 32}
          onClick={() => change(resized({ ...table, rows: [...table.rows, EMPTY] }))}
        >
          {words.addRow}
        </button>
        <button
          type="button"
          class="button"
          disabled={table.rows.length <= 1}
          onClick={() => change(resized({ ...table, rows: table.rows.slice(0, -1) }))}
        >
          {words.removeRow}
        </button>
      </div>
      <details open={table.mapped} onToggle={(event) => set({ mapped: event.currentTarget.open })}>
        <summary>{words.jointMap}</summary>
        <p class="soft">{words.jointMapHint}</p>
        <JointMap table={table} change={set} />
      </details>
    </>
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
                  <NumberInput label={words.mapCell(i + 1, j + 1)} value={typed} change={(next) => put(i, j, next)} />
                </td>
              ))}
              <td>
                <NumberInput
                  label={words.offsetCell(i + 1)}
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

function NumberInput({ label, value, change }: { label: string; value: string; change: (typed: string) => void }) {
  const bad = numberOf(value) === null;
  return (
    <input
      type="text"
      inputMode="decimal"
      aria-label={label}
      aria-invalid={bad}
      title={bad ? text.robots.number : undefined}
      value={value}
      onInput={(event) => change(event.currentTarget.value)}
      onFocus={(event) => event.currentTarget.select()}
    />
  );
}
