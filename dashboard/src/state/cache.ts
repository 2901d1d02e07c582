/** Answers kept by key: views that need the same names, sets or postures ask once, and come back at once. */
import { useCallback, useEffect, useState } from "preact/hooks";
import { problemOf } from "../api/client";
import type { Loaded, Loading } from "./load";

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
  const [loaded, set] = useState<Loaded<Value>>(() => keptNow<Value>(key));
  const [round, setRound] = useState(0);
  useEffect(() => {
    let gone = false;
    cached(key, load, age).then(
      (value) => gone || set({ state: "ready", value }),
      (error: unknown) => gone || set({ state: "failed", problem: problemOf(error) }),
    );
    const hear = (changed: string) => changed === key && setRound((r) => r + 1);
    followers.add(hear);
    return () => {
      gone = true;
      followers.delete(hear);
    };
  }, [key, round]);
  const reload = useCallback(() => {
    set({ state: "loading" });
    entries.delete(key);
    setRound((r) => r + 1);
  }, [key]);
  const put = useCallback((value: Value) => set({ state: "ready", value }), []);
  return { ...loaded, reload, put };
}

function keptNow<Value>(key: string): Loaded<Value> {
  const value = entries.get(key)?.value as Value | undefined;
  return value === undefined ? { state: "loading" } : { state: "ready", value };
}
