/** What is kept on this device: drafts, settings, and who is signed in. */
import { useLayoutEffect, useEffect, useState, useContext } from "preact/hooks";
import { createContext } from "preact";
import { type StiffnessUnit, UNIT_NAMES } from "../lib/stiffness";
import { api } from "../api/calls";
import { queries } from "../api/queries";
import { listen, news } from "../lib/events";
import type { Session } from "../api/types";
import { forgetKept, recalled, remember, remembered } from "./kept";
import { client, useQuery } from "./query";

/**
 * A field of a form: what was typed comes back with the view, as long as the browser's tab is open. Another name is
 * another form.
 */
export function useTypedValue<Value>(
  name: string,
  start: Value,
): [Value, (next: Value | ((before: Value) => Value)) => void] {
  const key = `form.${name}`; // what an older page kept under `draft.` had other fields
  const recall = () => ({ key, value: (recalled(key, "sessionStorage") as Value | null) ?? start });
  const [kept, set] = useState(recall);
  const { value } = kept.key === key ? kept : recall();
  // At once: an effect after the next frame is dropped where the view is left before that frame.
  useLayoutEffect(() => {
    const isStart = JSON.stringify(value) === JSON.stringify(start);
    remember(key, isStart ? null : value, "sessionStorage");
  }, [key, value]);
  return [
    value,
    (next) =>
      set((before) => {
        const last = before.key === key ? before.value : recall().value;
        return { key, value: typeof next === "function" ? (next as (before: Value) => Value)(last) : next };
      }),
  ];
}

/** A form that is filled in, whose fields are changed one by one. */
export function useDraft<Values extends object>(
  name: string,
  start: Values,
): [Values, (part: Partial<Values> | ((before: Values) => Partial<Values>)) => void] {
  const [values, set] = useTypedValue<Values>(name, start);
  const all = { ...start, ...values };
  return [
    all,
    (part) => set((before) => ({ ...start, ...before, ...(typeof part === "function" ? part(before) : part) })),
  ];
}

/** Forget what was typed into forms whose names begin so: it was sent. */
export const forgetTyped = (begin: string): void => {
  for (const name of remembered(`form.${begin}`, "sessionStorage")) remember(name, null, "sessionStorage");
};

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
  const { data, problem } = useQuery(queries.session);
  const { queryKey } = queries.session;
  const again = () => void client.fetchQuery({ ...queries.session, staleTime: 0 } as never).catch(() => undefined);
  useEffect(() => listen(news, { refused: again }), []);
  return [data ?? (problem ? "away" : "unknown"), (session) => client.setQueryData(queryKey, session)];
}

/** End the session of this device, and forget all that was shown. */
export async function signOut(): Promise<void> {
  await api.signOut();
  await forgetKept();
  location.reload();
}
