/** Lines of a text file by their numbers, to show the rows that the service found faults in. */
import type { FilePreview } from "./columns";

const MARKS = { comma: ",", semicolon: ";", tab: "\t" } as const;

export interface Line {
  line: number;
  cells: string[];
}

/** The cells of lines, numbered from 1, of a file's text. */
export function linesOf(content: string, { delimiter }: Pick<FilePreview, "delimiter">, wanted: number[]): Line[] {
  const lines = content.split(/\r\n|\r|\n/);
  return wanted.flatMap((line) => {
    const text = lines[line - 1];
    return text === undefined ? [] : [{ line, cells: cellsOf(text.trim(), delimiter ?? "comma") }];
  });
}

/** The number of cells in the first row of a text, by the mark that parts it most. */
export function widthOf(content: string): number {
  const first = content.split(/\r\n|\r|\n/).find((line) => line.trim() !== "" && !/^\s*(#|\/\/|%)/.test(line)) ?? "";
  const by = (["tab", "semicolon"] as const).find((mark) => first.includes(MARKS[mark]));
  return cellsOf(first.trim(), by ?? (first.includes(",") ? "comma" : "whitespace")).length;
}

/** Cells as they stand between delimiters; one between quotation marks within quotation marks parts none. */
function cellsOf(text: string, delimiter: NonNullable<FilePreview["delimiter"]>): string[] {
  const cells = delimiter === "whitespace" ? text.match(/"(?:[^"]|"")*"|\S+/g) : between(text, MARKS[delimiter]);
  return (cells ?? []).map((cell) => (/^".*"$/.test(cell) ? cell.slice(1, -1).replaceAll('""', '"') : cell));
}

function between(text: string, mark: string): string[] {
  const cells = `${mark}${text}`.matchAll(new RegExp(`${mark}("(?:[^"]|"")*"|[^${mark}]*)`, "g"));
  return [...cells].map(([, cell = ""]) => cell.trim());
}
