/** Loading what a view shows: loading, ready or failed, and never an answer to an older question. */
import { useCallback, useEffect, useState } from "preact/hooks";
import { problemOf } from "../api/client";
import type { Problem } from "../api/types";

export type Loaded<Value> =
  | { state: "loading" }
  | { state: "ready"; value: Value }
  | { state: "failed"; problem: Problem };

export type Loading<Value> = Loaded<Value> & { reload: () => void; put: (value: Value) => void };

/** Load again whenever `inputs` change. */
export function useLoad<Value>(load: (signal: AbortSignal) => Promise<Value>, inputs: unknown[]): Loading<Value> {
  const [loaded, set] = useState<Loaded<Value>>({ state: "loading" });
  const [round, setRound] = useState(0);
  useEffect(() => {
    const abort = new AbortController();
    set({ state: "loading" });
    load(abort.signal).then(
      (value) => abort.signal.aborted || set({ state: "ready", value }),
      (error: unknown) => abort.signal.aborted || set({ state: "failed", problem: problemOf(error) }),
    );
    return () => abort.abort();
  }, [...inputs, round]);
  const reload = useCallback(() => setRound((r) => r + 1), []);
  const put = useCallback((value: Value) => set({ state: "ready", value }), []);
  return { ...loaded, reload, put };
}

/** The value once it is there. */
export const valueOf = <Value>(loaded: Loaded<Value>): Value | null => (loaded.state === "ready" ? loaded.value : null);

/** Call `look` whenever one comes back to this tab, and now and then while it is seen. Answers with how to stop. */
export function whenSeen(look: () => void, every = 20_000): () => void {
  const seen = () => document.visibilityState === "visible" && look();
  const timer = setInterval(seen, every);
  document.addEventListener("visibilitychange", seen);
  return () => {
    clearInterval(timer);
    document.removeEventListener("visibilitychange", seen);
  };
}
