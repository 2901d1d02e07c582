/** Loading what a view shows: loading, ready or failed, and never an answer to an older question; or kept by a key. */
import { useCallback, useEffect, useState } from "preact/hooks";
import { problemOf } from "../api/client";
import type { Problem } from "../api/types";

export type Loading<Value> = (
  | { state: "loading" }
  | { state: "ready"; value: Value }
  | { state: "failed"; problem: Problem }
) & { reload: () => void };

type Loaded<Value> =
  | Omit<Extract<Loading<Value>, { state: "ready" }>, "reload">
  | { state: "loading" }
  | { state: "failed"; problem: Problem };

/** Load again whenever `inputs` change; what is `known` is shown meanwhile. */
export function useLoad<Value>(
  load: (signal: AbortSignal) => Promise<Value>,
  inputs: unknown[],
  known: () => Value | undefined = () => undefined,
): Loading<Value> {
  const before = (): Loaded<Value> => {
    const value = known();
    return value === undefined ? { state: "loading" } : { state: "ready", value };
  };
  const [loaded, set] = useState(before);
  const [round, setRound] = useState(0);
  useEffect(() => {
    const abort = new AbortController();
    set(before);
    load(abort.signal).then(
      (value) => abort.signal.aborted || set({ state: "ready", value }),
      (error: unknown) => abort.signal.aborted || set({ state: "failed", problem: problemOf(error) }),
    );
    return () => abort.abort();
  }, [...inputs, round]);
  const reload = useCallback(() => setRound((r) => r + 1), []);
  return { ...loaded, reload };
}

/** The value once it is there. */
export const valueOf = <Value>(loaded: Loading<Value>): Value | null =>
  loaded.state === "ready" ? loaded.value : null;

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

/** Listings older than this are asked for again while the old one is shown. */
const FRESH_MS = 2_000;
const MOST = 60;

interface Entry {
  answer: Promise<unknown>;
  value: unknown;
  at: number;
}

const entries = new Map<string, Entry>();
const followers = new Set<(key: string) => void>();

/** The answer to `key`, asked for unless it is kept and younger than `age`. */
export function cached<Value>(key: string, load: () => Promise<Value>, age = Number.POSITIVE_INFINITY): Promise<Value> {
  const before = entries.get(key);
  if (before && performance.now() - before.at <= age) return before.answer as Promise<Value>;
  const entry: Entry = { answer: load(), value: before?.value, at: performance.now() };
  entries.delete(key); // the newest stand last
  entries.set(key, entry);
  for (const oldest of entries.keys()) {
    if (entries.size <= MOST) break;
    entries.delete(oldest);
  }
  entry.answer.then(
    (value) => {
      entry.value = value;
    },
    () => entries.get(key) === entry && entries.delete(key), // a failure is not kept
  );
  return entry.answer as Promise<Value>;
}

/** Forget what starts with `prefix`: it has changed. Views that show it ask again. */
export function forget(prefix: string): void {
  const gone = [...entries.keys()].filter((key) => key.startsWith(prefix));
  for (const key of gone) entries.delete(key);
  for (const key of gone) followers.forEach((hear) => hear(key));
}

/** Show what is kept at once, and what is new when it comes. */
export function useCached<Value>(key: string, load: () => Promise<Value>, age = FRESH_MS): Loading<Value> {
  const loaded = useLoad(
    () => cached(key, load, age),
    [key],
    () => entries.get(key)?.value as Value | undefined,
  );
  useEffect(() => {
    const hear = (changed: string) => changed === key && loaded.reload();
    followers.add(hear);
    return () => void followers.delete(hear);
  }, [key]);
  const reload = useCallback(() => {
    entries.delete(key);
    loaded.reload();
  }, [key]);
  return { ...loaded, reload };
}
