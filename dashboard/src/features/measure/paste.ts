/** A block of readings pasted into the live form: the service reads the block as it reads files of an import. */
import type { ImportAnswer, ImportOptions } from "../../api/types";
import type { Rows, Typed } from "./live";
import { numberIn } from "../../lib/schema";

const HEADER = [
  "point",
  ...["unloaded", "loaded"].flatMap((state) => ["x", "y", "z"].map((axis) => `${state} ${axis} [mm]`)),
];

/** A text of the clipboard, and the box that it was pasted into. */
export interface Block {
  target: string;
  column: keyof Typed;
  text: string;
}

/** What a block says about a target that the form does not have. */
export interface Unmatched {
  name: string;
  typed: Partial<Typed>;
}

export interface Placed {
  rows: Rows;
  unmatched: Unmatched[];
  /** What was not understood, with its line. */
  faults: string[];
  /** Whether the block does not show which mark is the decimal one: 123,456. */
  asksForMark: boolean;
}

/** Whether a line begins with a name: its first cell is no number, or one cell more than the numbers of one state or both. */
const isNamed = (cells: readonly string[]): boolean => cells.length % 3 === 1 || Number.isNaN(numberIn(cells[0] ?? ""));

/**
 * Cells of a line: parted by semicolons or tabs, by commas where these are no decimal marks, else by blanks. Commas with
 * a blank behind them part numbers that have decimal commas: 1,5, 2,5, 3,5.
 */
function cellsOf(line: string): string[] {
  const mark = [";", "\t"].find((each) => line.includes(each));
  if (mark) return line.split(mark).map((cell) => cell.trim());
  if (/\d\.\d.*,|,.*\d\.\d/.test(line)) return line.trim().split(/\s*,\s*/);
  const cells = line.trim().split(/,\s/.test(line) ? /\s*,\s+/ : /\s+/);
  const hasLists = /,\s/.test(line) && cells.some((cell) => cell.split(",").length > 2); // P1, 1,2,3
  return hasLists ? line.trim().split(/\s*,\s*/) : cells;
}

const linesOf = (clipboard: string): string[] => clipboard.split(/\r?\n/).filter((line) => line.trim());

/** Whether a text is a block: several lines, a name, or the numbers of both states. */
export function isBlock(clipboard: string): boolean {
  const lines = linesOf(clipboard);
  const [first = []] = lines.map(cellsOf);
  return lines.length > 1 || first.length > 3;
}

/**
 * The files that a block is: its cells as they are, behind a header. Lines without a name are the targets `names` from
 * `target` on; a line beyond them is named by its number. Three numbers are of one state, six are of both.
 */
export function filesOf(clipboard: string, names: readonly string[], target: string): [File[], ImportOptions] {
  const begin = names.indexOf(target);
  const rows = linesOf(clipboard).map((line, i) => {
    const cells = cellsOf(line);
    const named = isNamed(cells) ? cells : [names[begin + i] ?? `line ${i + 1}`, ...cells];
    return named.length === 4 ? [...named, ...named.slice(1)] : named;
  });
  const text = [HEADER, ...rows].map((row) => row.join(";")).join("\n");
  const files = [new File(["label;J1 [rad]\nm01;0\n"], "joints.csv"), new File([text], "m01.txt")];
  const stated = { file_name: "{label}", point_name: "{target}", encoders: "motor", load_point: [0, 0, 0] };
  const more = { length_unit: "mm", force: [0, 0, -1], units: { force: "N" }, delimiter: "semicolon" };
  return [files, { ...stated, ...more, accept_unusual: true, show_faults: true } as unknown as ImportOptions];
}

/** What was read of a block that was pasted into a column: rows with it, and what has no place in them. */
export function placed(answer: ImportAnswer, rows: Rows, column: keyof Typed, clipboard: string): Placed {
  const faults = [...answer.faults.map(({ line, reason, remedy }) => said(line, reason, remedy)), ...answer.missing];
  const both = linesOf(clipboard).some((line) => cellsOf(line).length > 4);
  const filled: Rows = { ...rows };
  const unmatched: Unmatched[] = [];
  for (const { target, unloaded, loaded } of answer.measurement_set?.observations[0]?.readings ?? []) {
    const numbers = { unloaded: (unloaded ?? []).join(" "), loaded: (loaded ?? []).join(" ") };
    // Three numbers are read as both states alike: they go where they were pasted.
    const typed: Partial<Typed> = both
      ? numbers
      : { [column]: column === "loaded" ? numbers.loaded : numbers.unloaded };
    const before = filled[target];
    if (before) filled[target] = { ...before, ...typed };
    else unmatched.push({ name: target, typed });
  }
  return {
    rows: filled,
    unmatched,
    faults,
    asksForMark: answer.faults.some(({ option }) => option === "decimal_mark"),
  };
}

/** A fault with its line of the block, in which there is no header. */
const said = (line: number | null, reason: string, remedy: string): string =>
  `${line === null ? "" : `line ${Math.max(1, line - 1)}: `}${reason}; ${remedy}`;
