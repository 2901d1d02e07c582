/** Files of readings as the service understands them: asked again whenever the options change. Nothing is stored. */
import { useEffect, useState } from "preact/hooks";
import { api, problemOf } from "../api/client";
import type { ImportAnswer, ImportOptions, Problem } from "../api/types";

/** Someone who types is let finish before the files are sent again. */
const PAUSE_MS = 300;

export interface Understood {
  answer: ImportAnswer | null;
  problem: Problem | null;
  /** Whether a newer answer is on its way. */
  busy: boolean;
}

/** While a new answer is on its way the last one stays, and counts as busy from the first moment. */
export function useImport(files: File[], options: ImportOptions): Understood {
  const asked = JSON.stringify(options);
  const [{ of, ...heard }, set] = useState<Omit<Understood, "busy"> & { of: string | null }>({
    answer: null,
    problem: null,
    of: null,
  });
  useEffect(() => {
    const abort = new AbortController();
    const ask = () =>
      api.importFiles(files, { ...options, show_faults: true }, abort.signal).then(
        (answer) => abort.signal.aborted || set({ answer, problem: null, of: asked }),
        (error: unknown) =>
          abort.signal.aborted || set(({ answer }) => ({ answer, problem: problemOf(error), of: asked })),
      );
    const pause = setTimeout(() => void ask(), of === null ? 0 : PAUSE_MS);
    return () => {
      clearTimeout(pause);
      abort.abort();
    };
  }, [files, asked]);
  return { ...heard, busy: of !== asked };
}
