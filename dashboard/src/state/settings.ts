/** What people set for this device: theme and unit of stiffness. Kept in the browser, nowhere else. */
import { createContext } from "preact";
import { useContext, useEffect, useState } from "preact/hooks";
import { type StiffnessUnit, UNIT_NAMES } from "../lib/units";

export type Theme = "auto" | "light" | "dark";

export interface Settings {
  theme: Theme;
  unit: StiffnessUnit;
  change: (settings: { theme?: Theme; unit?: StiffnessUnit }) => void;
}

const KEYS = { theme: "jointstiff.theme", unit: "jointstiff.unit" };

export const SettingsContext = createContext<Settings>({ theme: "auto", unit: "MNm", change: () => undefined });

export const useSettings = (): Settings => useContext(SettingsContext);

/** The settings of this device, and the theme put on the page. */
export function useStoredSettings(): Settings {
  const [theme, setTheme] = useState<Theme>(() => oneOf(read(KEYS.theme), ["auto", "light", "dark"], "auto"));
  const [unit, setUnit] = useState<StiffnessUnit>(() => oneOf(read(KEYS.unit), UNIT_NAMES, "MNm"));
  useEffect(() => {
    document.documentElement.dataset["theme"] = theme;
    dispatchEvent(new Event("themechange"));
  }, [theme]);
  return {
    theme,
    unit,
    change: (settings) => {
      if (settings.theme) write(KEYS.theme, settings.theme, setTheme);
      if (settings.unit) write(KEYS.unit, settings.unit, setUnit);
    },
  };
}

function oneOf<Choice extends string>(value: string | null, choices: Choice[], otherwise: Choice): Choice {
  return choices.find((choice) => choice === value) ?? otherwise;
}

function read(key: string): string | null {
  try {
    return localStorage.getItem(key);
  } catch {
    return null; // storage may be switched off
  }
}

function write<Value extends string>(key: string, value: Value, set: (value: Value) => void): void {
  set(value);
  try {
    localStorage.setItem(key, value);
  } catch {
    // then it holds for this visit
  }
}
