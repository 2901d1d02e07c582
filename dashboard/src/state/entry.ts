/** What an entry of the browser's history keeps, so that *Back* brings it back: the place of the view, and what was chosen. */
import { useEffect, useState } from "preact/hooks";
import { listen } from "../lib/events";

const stateOfEntry = (): Record<string, unknown> => (history.state as Record<string, unknown> | null) ?? {};

function keepOnEntry(name: string, value: unknown): void {
  history.replaceState({ ...stateOfEntry(), [name]: value }, "");
}

/** A value of the present entry; an entry that has none yet begins with `start`. */
export function useKeptOnEntry<Value>(name: string, start: Value): [Value, (by: (before: Value) => Value) => void] {
  const recall = () => (stateOfEntry()[name] as Value | undefined) ?? start;
  const [value, set] = useState(recall);
  useEffect(() => listen(window, { hashchange: () => set(recall) }), [name]);
  const put = (by: (before: Value) => Value) => {
    keepOnEntry(name, by(recall()));
    set(recall);
  };
  return [value, put];
}

/** Browsers limit how often an entry may be changed. */
const PAUSE_MS = 200;
/** A view that is shown again may need this time to be as long as it was. */
const LONGEST_MS = 3_000;

/** Keep on each entry how far its view was scrolled. */
export function keepPlaces(): () => void {
  history.scrollRestoration = "manual"; // views come later than the browser waits
  let timer: ReturnType<typeof setTimeout> | undefined;
  const keepLater = () => {
    clearTimeout(timer);
    timer = setTimeout(() => keepOnEntry("top", scrollY), PAUSE_MS);
  };
  return listen(window, { scroll: keepLater, hashchange: () => clearTimeout(timer) });
}

/** Scroll to where the view of the present entry was left: a new entry begins at its top. */
export function goToPlace(): void {
  const top = Number(stateOfEntry()["top"] ?? 0);
  const ends = performance.now() + LONGEST_MS;
  const moved = new AbortController();
  for (const name of ["wheel", "touchstart", "keydown", "hashchange"])
    addEventListener(name, () => moved.abort(), { once: true, passive: true, signal: moved.signal });
  const step = () => {
    if (moved.signal.aborted) return;
    scrollTo(0, top);
    const isThere = Math.abs(scrollY - top) < 1;
    if (isThere || performance.now() > ends) moved.abort();
    else requestAnimationFrame(step);
  };
  step();
}
