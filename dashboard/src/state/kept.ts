/** What was begun on this device, until it is done: it survives a reload, and a session that ends. */
import { useEffect, useState } from "preact/hooks";
import { marked, unmarked } from "../lib/json";

const NAME = "kept";

function places(): Promise<IDBObjectStore> {
  return new Promise((done, fail) => {
    const asked = indexedDB.open("jointstiff", 1);
    asked.onupgradeneeded = () => asked.result.createObjectStore(NAME);
    asked.onsuccess = () => done(asked.result.transaction(NAME, "readwrite").objectStore(NAME));
    asked.onerror = () => fail(asked.error);
  });
}

/** Keep a value, files among them, under a name; null forgets it. Where storage is switched off nothing is kept. */
export async function keep(name: string, value: unknown): Promise<void> {
  const place = await places().catch(() => null);
  if (value === null) place?.delete(name);
  else place?.put(marked(value), name);
}

/** What is kept under a name, or null. */
export async function kept<Value>(name: string): Promise<Value | null> {
  const place = await places().catch(() => null);
  if (!place) return null;
  const asked = place.get(name) as IDBRequest<Value | undefined>;
  return new Promise((done) => {
    asked.onsuccess = () => done((unmarked(asked.result) as Value) ?? null);
    asked.onerror = () => done(null);
  });
}

type Place = "localStorage" | "sessionStorage";

/** What the browser keeps as JSON under a name, else null: it may be of anyone, and storage may be switched off. */
export function recalled(name: string, place: Place = "localStorage"): unknown {
  try {
    return unmarked(JSON.parse(window[place].getItem(`jointstiff.${name}`) ?? "null"));
  } catch {
    return null;
  }
}

/** Keep it, or forget null; where storage is switched off it holds for this visit. */
export function remember(name: string, value: unknown, place: Place = "localStorage"): void {
  try {
    if (value === null) window[place].removeItem(`jointstiff.${name}`);
    else window[place].setItem(`jointstiff.${name}`, JSON.stringify(marked(value)));
  } catch {
    // then it holds until the view is left
  }
}

/** A form that is filled in: what was typed comes back with the view, as long as the browser's tab is open. */
export function useDraft<Values extends object>(
  name: string,
  start: Values,
): [Values, (part: Partial<Values> | ((before: Values) => Partial<Values>)) => void] {
  const key = `form.${name}`; // what an older page kept under `draft.` had other fields
  const [values, set] = useState<Values>(() => ({ ...start, ...(recalled(key, "sessionStorage") as Values | null) }));
  useEffect(() => remember(key, values, "sessionStorage"), [key, values]);
  return [values, (part) => set((before) => ({ ...before, ...(typeof part === "function" ? part(before) : part) }))];
}
