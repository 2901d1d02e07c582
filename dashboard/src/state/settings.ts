/** What people set for this device: theme and unit of stiffness. Kept in the browser, nowhere else. */
import { createContext } from "preact";
import { useContext, useEffect, useState } from "preact/hooks";
import { type StiffnessUnit, UNIT_NAMES } from "../lib/units";
import { recalled, remember } from "./kept";

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
