/** Tables as CSV (RFC 4180) that a spreadsheet opens without carrying out what a name says. */

export type Cell = string | number | null | undefined;

const FORMULA = /^[\s]*[=+\-@＝＋－＠\t\r|%]/;

/** One field: numbers as they are, text guarded against formulas and quoted where needed. */
export function csvCell(cell: Cell): string {
  if (cell === null || cell === undefined) return "";
  if (typeof cell === "number") return Number.isFinite(cell) ? String(cell) : "";
  const guarded = FORMULA.test(cell) ? `'${cell}` : cell;
  return /["',;\r\n\t]/.test(guarded) ? `"${guarded.replaceAll('"', '""')}"` : guarded;
}

/** A whole table, with a byte order mark so that spreadsheets read it as UTF-8. */
export function csv(head: string[], rows: Cell[][]): string {
  return `\ufeff${[head, ...rows].map((row) => row.map(csvCell).join(",")).join("\r\n")}\r\n`;
}

/** A file name of what is safe in any file system. */
export function fileName(title: string, extension: string): string {
  const plain = title
    .normalize("NFKD")
    .replace(/[^A-Za-z0-9._-]+/g, "-")
    .replace(/^[-.]+|[-.]+$/g, "");
  return `${plain.slice(0, 80).toLowerCase() || "jointstiff"}.${extension}`;
}
