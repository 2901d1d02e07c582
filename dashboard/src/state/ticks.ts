/** Which readings of a plan are done: kept in this browser, nowhere else. */
import { useState } from "preact/hooks";

const keyOf = (plan: string): string => `jointstiff.plan.${plan}`;

export function useTicks(plan: string): [Set<string>, (labels: string[], done: boolean) => void] {
  const [ticks, set] = useState(() => read(plan));
  const change = (labels: string[], done: boolean) => {
    const next = new Set(ticks);
    for (const label of labels) done ? next.add(label) : next.delete(label);
    set(next);
    try {
      localStorage.setItem(keyOf(plan), JSON.stringify([...next]));
    } catch {
      // storage may be switched off: then they hold for this visit
    }
  };
  return [ticks, change];
}

function read(plan: string): Set<string> {
  try {
    const kept: unknown = JSON.parse(localStorage.getItem(keyOf(plan)) ?? "[]");
    return new Set(Array.isArray(kept) ? kept.filter((label) => typeof label === "string") : []);
  } catch {
    return new Set();
  }
}
