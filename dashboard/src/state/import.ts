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

/** While a new answer is on its way the last one stays. */
export function useImport(files: File[], options: ImportOptions): Understood {
  const [understood, set] = useState<Understood>({ answer: null, problem: null, busy: true });
  const asked = JSON.stringify(options);
  useEffect(() => {
    const abort = new AbortController();
    set((last) => ({ ...last, busy: true }));
    const ask = () =>
      api.importFiles(files, { ...options, show_faults: true }, abort.signal).then(
        (answer) => abort.signal.aborted || set({ answer, problem: null, busy: false }),
        (error: unknown) =>
          abort.signal.aborted || set(({ answer }) => ({ answer, problem: problemOf(error), busy: false })),
      );
    const pause = setTimeout(() => void ask(), understood.answer === null ? 0 : PAUSE_MS);
    return () => {
      clearTimeout(pause);
      abort.abort();
    };
  }, [files, asked]);
  return understood;
}
