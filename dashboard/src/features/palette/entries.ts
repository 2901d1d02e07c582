/** What the command palette offers: actions of the page, views, and what the service finds. */
import { queries } from "../../api/queries";
import { go, link } from "../../state/action";
import { ask } from "../../state/query";
import { text } from "../../words";
import { gearboxWords } from "../gearbox/words";
import { geometryWords } from "../geometry/words";
import { measureWords } from "../measure/words";
import { planWords } from "../plan/words";
import { robotWords } from "../robots/words";
import type { paletteWords } from "./words";

export interface Entry {
  kind: keyof typeof paletteWords.kinds;
  name: string;
  note?: string;
  run: () => void;
}

const view = (name: string, ...parts: string[]): Entry => ({ kind: "view", name, run: () => go(link(parts)) });

const VIEWS: readonly Entry[] = [
  view(text.app.measure),
  view(text.app.runs, "runs"),
  view(text.app.robots, "robots"),
  view(robotWords.add, "robots", "new"),
  view(robotWords.sets, "sets"),
  view(measureWords.title, "measure"),
  view(planWords.begin, "plans"),
  view(text.app.compare, "compare", "methods"),
  view(geometryWords.title, "geometries"),
  view(gearboxWords.title, "gearboxes"),
];

/** Whether each word that was typed is in a name. */
export function matches(name: string, typed: string): boolean {
  const words = typed.toLowerCase().split(/\s+/);
  return words.every((word) => name.toLowerCase().includes(word));
}

/** Buttons and links of the head of the view, those behind *More* among them, and its tabs. */
export function actionsOfPage(root: ParentNode = document): Entry[] {
  const found = root.querySelectorAll<HTMLElement>("main .head .actions :is(a, button), main .tabs a");
  return [...found]
    .filter((each) => !(each instanceof HTMLButtonElement && each.disabled))
    .map((each) => ({ kind: "action", name: each.textContent?.trim() ?? "", run: () => each.click() }));
}

/** Most that is shown of each kind. */
const SHOWN = 4;

/** Actions and views whose name has the words. */
export const ownEntries = (actions: Entry[], typed: string): Entry[] =>
  [...actions, ...VIEWS].filter(({ name }) => matches(name, typed)).slice(0, typed.trim() ? SHOWN : 2 * SHOWN);

/** Robots, sets and runs that the service finds. */
export async function foundEntries(typed: string): Promise<Entry[]> {
  const q = typed.trim();
  if (!q) return [];
  const [robots, sets, runs] = await Promise.all([
    ask(queries.robots({ q, limit: SHOWN })),
    ask(queries.sets({ q, limit: SHOWN })),
    ask(queries.runs({ q, limit: SHOWN })),
  ]);
  return [
    ...robots.items.map(
      ({ id, name, last_campaign: last }): Entry => ({
        kind: "robot",
        name,
        ...(last?.serial_number ? { note: last.serial_number } : {}),
        run: () => go(link(["robots", id])),
      }),
    ),
    ...sets.items.map(
      ({ id, name, serial_number: serial }): Entry => ({
        kind: "set",
        name,
        ...(serial ? { note: serial } : {}),
        run: () => go(link(["sets", id])),
      }),
    ),
    ...runs.items.map(
      ({ id, measurement_set_name: name, robot_name: robot }): Entry => ({
        kind: "run",
        name: name ?? "…",
        ...(robot ? { note: robot } : {}),
        run: () => go(link(["runs", id])),
      }),
    ),
  ];
}
