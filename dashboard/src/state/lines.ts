/** Rows of a dropped text file that the preview leaves out: those with faults. */
import { useEffect, useState } from "preact/hooks";
import type { FilePreview, ImportFault } from "../lib/columns";
import { type Line, linesOf } from "../lib/lines";

export function useLines(file: File | undefined, preview: FilePreview, faults: ImportFault[]): Line[] {
  const [lines, set] = useState<Line[]>([]);
  const known = new Set([...preview.first_lines, ...preview.header_lines]);
  const wanted = [...new Set(faults.flatMap(({ line }) => (line === null || known.has(line) ? [] : [line])))];
  wanted.sort((a, b) => a - b);
  const question = preview.format === "text" ? wanted.join() : "";
  useEffect(() => {
    let gone = false;
    if (question === "" || !file) set([]);
    else
      void file.arrayBuffer().then((bytes) => {
        if (!gone) set(linesOf(decoded(bytes, preview.encoding), preview, wanted));
      });
    return () => {
      gone = true;
    };
  }, [question, file]);
  return lines;
}

function decoded(bytes: ArrayBuffer, encoding: string | null): string {
  try {
    return new TextDecoder(encoding ?? "utf-8").decode(bytes);
  } catch {
    return new TextDecoder("latin1").decode(bytes);
  }
}
