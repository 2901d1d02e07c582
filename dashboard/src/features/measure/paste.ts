/** A block of readings pasted into the live form, a line for each target. */
import { numberIn } from "../../lib/schema";
import type { Rows, Typed } from "./live";
import { measureWords } from "./words";

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
  /** Lines that were not understood. */
  faults: string[];
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
 * Rows with the numbers of a block, and what has no place in them. Lines without a name are the targets from the box's
 * on; a line beyond them is named by its number. Three numbers go into the column of the box, six into both states.
 */
export function placed({ target, column, text }: Block, rows: Rows): Placed {
  const names = Object.keys(rows);
  const begin = names.indexOf(target);
  const answer: Placed = { rows: { ...rows }, unmatched: [], faults: [] };
  linesOf(text).forEach((line, i) => {
    const cells = cellsOf(line);
    const [first = ""] = cells;
    const named = isNamed(cells);
    const name = named ? first : (names[begin + i] ?? `line ${i + 1}`);
    const numbers = (named ? cells.slice(1) : cells).map((cell) => numberIn(cell) ?? Number.NaN);
    if ((numbers.length !== 3 && numbers.length !== 6) || numbers.some(Number.isNaN)) {
      answer.faults.push(measureWords.notNumbers(i + 1, line.trim()));
      return;
    }
    const [one, other] = [numbers.slice(0, 3).join(" "), numbers.slice(3).join(" ")];
    const typed: Partial<Typed> = other ? { unloaded: one, loaded: other } : { [column]: one };
    const before = answer.rows[name];
    if (before) answer.rows[name] = { ...before, ...typed };
    else answer.unmatched.push({ name, typed });
  });
  return answer;
}
