/** Something that a button starts: busy while it goes on, and its problem if it fails. */
import { useCallback, useRef, useState } from "preact/hooks";
import { problemOf } from "../api/client";
import type { Problem } from "../api/types";

export interface Action<Arguments extends unknown[]> {
  run: (...args: Arguments) => void;
  busy: boolean;
  problem: Problem | null;
}

/** A second start while the first goes on does nothing: gloves tap twice. */
export function useAction<Arguments extends unknown[]>(
  act: (...args: Arguments) => Promise<unknown>,
): Action<Arguments> {
  const [busy, setBusy] = useState(false);
  const [problem, setProblem] = useState<Problem | null>(null);
  const going = useRef(false);
  const run = useCallback(
    (...args: Arguments) => {
      if (going.current) return;
      going.current = true;
      setBusy(true);
      setProblem(null);
      act(...args)
        .catch((error: unknown) => setProblem(problemOf(error)))
        .finally(() => {
          going.current = false;
          setBusy(false);
        });
    },
    [act],
  );
  return { run, busy, problem };
}
