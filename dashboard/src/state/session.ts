/** What is kept on this device: drafts, settings, and who is signed in. */
import { useLayoutEffect, useEffect, useState, useContext } from "preact/hooks";
import { createContext } from "preact";
import { createStore, del, get, set } from "idb-keyval";
import { type StiffnessUnit, UNIT_NAMES } from "../lib/stiffness";
import { api } from "../api/client";
import { listen, news } from "../lib/events";
import type { Session } from "../api/types";

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

/** A form that is filled in: what was typed comes back with the view, as long as the browser's tab is open. */
export function useDraft<Values extends object>(
  name: string,
  start: Values,
): [Values, (part: Partial<Values> | ((before: Values) => Partial<Values>)) => void] {
  const key = `form.${name}`; // what an older page kept under `draft.` had other fields
  const [values, set] = useState<Values>(() => ({ ...start, ...(recalled(key, "sessionStorage") as Values | null) }));
  // At once: an effect after the next frame is dropped where the view is left before that frame.
  useLayoutEffect(() => remember(key, values, "sessionStorage"), [key, values]);
  return [values, (part) => set((before) => ({ ...before, ...(typeof part === "function" ? part(before) : part) }))];
}

export const THEMES = ["auto", "light", "dark"] as const;
export type Theme = (typeof THEMES)[number];

export interface Settings {
  theme: Theme;
  unit: StiffnessUnit;
  change: (settings: { theme?: Theme; unit?: StiffnessUnit }) => void;
}

export const SettingsContext = createContext<Settings>({ theme: "auto", unit: "MNm", change: () => undefined });

export const useSettings = (): Settings => useContext(SettingsContext);

/** The settings of this device, and the theme put on the page. */
export function useStoredSettings(): Settings {
  const [{ theme, unit }, set] = useState(() => {
    const before = (recalled("settings") ?? {}) as { theme?: Theme; unit?: StiffnessUnit };
    return {
      theme: THEMES.find((one) => one === before.theme) ?? "auto",
      unit: UNIT_NAMES.find((one) => one === before.unit) ?? "MNm",
    };
  });
  useEffect(() => {
    document.documentElement.dataset["theme"] = theme;
    dispatchEvent(new Event("themechange"));
  }, [theme]);
  return {
    theme,
    unit,
    change: (part) => {
      set((before) => ({ ...before, ...part }));
      remember("settings", { theme, unit, ...part });
    },
  };
}

/** `unknown` until the service says; `away` if it does not: views say why. */
export type Standing = Session | "unknown" | "away";

/** Whether the key is a viewer's, who may look but not begin, change or delete anything. */
export const Viewer = createContext(false);

export const isViewer = (session: Standing): boolean => typeof session === "object" && session.role === "viewer";

/** Whether a key has to be entered before anything can be seen. */
export const needsKey = (session: Standing): boolean =>
  typeof session === "object" && session.access === "keys" && session.key_id === null;

/** Who is signed in, and how to say that it changed; an answer that a key is needed asks the service again. */
export function useSession(): [Standing, (session: Session) => void] {
  const [session, set] = useState<Standing>("unknown");
  useEffect(() => {
    const ask = () => void api.session().then(set, () => set((before) => (before === "unknown" ? "away" : before)));
    ask();
    return listen(news, { refused: ask });
  }, []);
  return [session, set];
}

/** End the session of this device, and forget all that was shown. */
export async function signOut(): Promise<void> {
  await api.signOut();
  await keep("files", null);
  location.reload();
}
