/** What this device keeps: files and answers in a database of the browser, small values as JSON. */
import { clear, createStore, del, get, set } from "idb-keyval";

const STORE = createStore("jointstiff", "kept");

/** What comes of it; null where storage is switched off. */
const tried = <Value>(act: () => Promise<Value>): Promise<Value | null> =>
  Promise.resolve()
    .then(act)
    .catch(() => null);

/** Keep a value, files among them, under a name; null forgets it. */
export const keep = (name: string, value: unknown): Promise<void | null> =>
  tried(() => (value === null ? del(name, STORE) : set(name, value, STORE)));

/** What is kept under a name, or null. */
export const kept = <Value>(name: string): Promise<Value | null> =>
  tried(async () => (await get<Value>(name, STORE)) ?? null);

type Place = "localStorage" | "sessionStorage";

/** JSON of what storage refused, as it is switched off or full, by name: kept until the page is left. */
const unstored: Record<Place, Map<string, string>> = { localStorage: new Map(), sessionStorage: new Map() };

/** Whether storage has refused what is kept under a name, so that it is gone when the page is left. */
export const isUnstored = (name: string, place: Place = "localStorage"): boolean => unstored[place].has(name);

/** What the browser keeps as JSON under a name, else null: it may be of anyone, and storage may be switched off. */
export function recalled(name: string, place: Place = "localStorage"): unknown {
  try {
    return JSON.parse(unstored[place].get(name) ?? window[place].getItem(`jointstiff.${name}`) ?? "null");
  } catch {
    return null;
  }
}

/** The names that begin so and hold something, in order. */
export function remembered(begin: string, place: Place = "localStorage"): string[] {
  const names = new Set([...unstored[place].keys()].filter((name) => name.startsWith(begin)));
  try {
    for (const name of Object.keys(window[place]))
      if (name.startsWith(`jointstiff.${begin}`)) names.add(name.slice("jointstiff.".length));
  } catch {
    // storage is switched off
  }
  return [...names].sort();
}

/** Keep it, or forget null; where storage is switched off or full it holds until the page is left. */
export function remember(name: string, value: unknown, place: Place = "localStorage"): void {
  unstored[place].delete(name);
  try {
    if (value === null) window[place].removeItem(`jointstiff.${name}`);
    else window[place].setItem(`jointstiff.${name}`, JSON.stringify(value));
  } catch {
    if (value !== null) unstored[place].set(name, JSON.stringify(value));
  }
}

/** Forget what is kept in the database: it is of whoever was signed in. */
export const forgetKept = (): Promise<void | null> => tried(() => clear(STORE));
