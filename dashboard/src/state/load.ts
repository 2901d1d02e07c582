/** Loading what a view shows: loading, ready or failed, and never an answer to an older question; names and postures among it. */
import { useCallback, useEffect, useState, useRef } from "preact/hooks";
import { problemOf, api, every } from "../api/client";
import type {
  Problem,
  MeasurementSet,
  MeasurementSetSummary,
  Robot,
  RobotSummary,
  Posture,
  RobotDocument,
  RobotSource,
} from "../api/types";
import { listen, news, tell } from "../lib/events";
import { dayText, timeText } from "../lib/format";
import { text } from "../i18n";

type Loaded<Value> = { state: "loading" } | { state: "ready"; value: Value } | { state: "failed"; problem: Problem };

export type Loading<Value> = Loaded<Value> & { reload: () => void };

/** Load again whenever `inputs` change; what is `known` is shown meanwhile. */
export function useLoad<Value>(
  load: (signal: AbortSignal) => Promise<Value>,
  inputs: unknown[],
  known: () => Value | undefined = () => undefined,
): Loading<Value> {
  const before = (): Loaded<Value> => {
    const value = known();
    return value === undefined ? { state: "loading" } : { state: "ready", value };
  };
  const [loaded, set] = useState(before);
  const [round, setRound] = useState(0);
  useEffect(() => {
    const abort = new AbortController();
    set(before);
    load(abort.signal).then(
      (value) => abort.signal.aborted || set({ state: "ready", value }),
      (error: unknown) => abort.signal.aborted || set({ state: "failed", problem: problemOf(error) }),
    );
    return () => abort.abort();
  }, [...inputs, round]);
  const reload = useCallback(() => setRound((r) => r + 1), []);
  return { ...loaded, reload };
}

/** The value once it is there. */
export const valueOf = <Value>(loaded: Loading<Value>): Value | null =>
  loaded.state === "ready" ? loaded.value : null;

/** Call `look` whenever one comes back to this tab, and now and then while it is seen. Answers with how to stop. */
export function whenSeen(look: () => void, every = 20_000): () => void {
  const seen = () => document.visibilityState === "visible" && look();
  const timer = setInterval(seen, every);
  const stop = listen(document, { visibilitychange: seen });
  return () => {
    clearInterval(timer);
    stop();
  };
}

/** Listings older than this are asked for again while the old one is shown. */
const FRESH_MS = 2_000;
const MOST = 60;

interface Entry {
  answer: Promise<unknown>;
  value: unknown;
  at: number;
}

const entries = new Map<string, Entry>();

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
  for (const key of entries.keys()) if (key.startsWith(prefix)) entries.delete(key);
  tell("forgotten", prefix);
}

/** Show what is kept at once, and what is new when it comes. */
export function useCached<Value>(key: string, load: () => Promise<Value>, age = FRESH_MS): Loading<Value> {
  const loaded = useLoad(
    () => cached(key, load, age),
    [key],
    () => entries.get(key)?.value as Value | undefined,
  );
  useEffect(() => {
    const forgotten = ({ detail }: CustomEvent<string>) => key.startsWith(detail) && loaded.reload();
    return listen(news, { forgotten });
  }, [key]);
  const reload = useCallback(() => {
    entries.delete(key);
    loaded.reload();
  }, [key]);
  return { ...loaded, reload };
}

export interface Names {
  robots: RobotSummary[];
  sets: MeasurementSetSummary[];
  /** Of robots of one name with serial number, number of joints and last campaign. */
  robot: (id: string) => string;
  set: (id: string) => string;
}

const KEY = "names";

/** All names; an identifier that is not among them stands for itself. */
export function useNames(): Loading<Names> {
  return useCached(KEY, loadNames);
}

/** A robot or a set was added, deleted, restored, or changed. */
export const namesChanged = (): void => [KEY, "robot/", "set/"].forEach(forget);

/** Robots and measurement sets. Sets never change but by what is noted of them; of robots the last campaign does. */
export const storedSet = (id: string): Promise<MeasurementSet> => cached(`set/${id}`, () => api.sets.one(id));
export const storedRobot = (id: string): Promise<Robot> => cached(`robot/${id}`, () => api.robots.one(id), 2_000);

async function loadNames(): Promise<Names> {
  const [robots, sets] = await Promise.all([every(api.robots.list, {}, 1000), every(api.sets.list, {}, 1000)]);
  const robotNames = robotsToldApart(robots, sets);
  const setNames = setsToldApart(sets);
  return {
    robots,
    sets,
    robot: (id) => robotNames.get(id) ?? id.slice(0, 8),
    set: (id) => setNames.get(id) ?? id.slice(0, 8),
  };
}

/** The name of each item; where several have it, with hints that tell them apart. */
function toldApart<Item extends { id: string; name: string }>(
  items: Item[],
  hints: (item: Item) => string[],
): Map<string, string> {
  const several = new Set(
    items.filter(({ name }, i) => items.findIndex((one) => one.name === name) < i).map(({ name }) => name),
  );
  const shown = (item: Item) => (several.has(item.name) ? [item.name, ...hints(item)].join(" · ") : item.name);
  return new Map(items.map((item) => [item.id, shown(item)]));
}

/** Sets with serial number and time. */
export const setsToldApart = (
  sets: Pick<MeasurementSetSummary, "id" | "name" | "serial_number" | "measured_at" | "created_at">[],
): Map<string, string> =>
  toldApart(sets, ({ serial_number: serial, measured_at: at, created_at: stored }) => [
    ...(serial ? [serial] : []),
    timeText(at ?? stored),
  ]);

/** Robots with the serial numbers that their sets state, number of joints and last campaign. */
export const robotsToldApart = (
  robots: Pick<RobotSummary, "id" | "name" | "created_at" | "joints">[],
  sets: Pick<MeasurementSetSummary, "robot_id" | "serial_number" | "measured_at" | "created_at">[],
): Map<string, string> =>
  toldApart(robots, ({ id, created_at, joints }) => {
    const own = sets.filter((set) => set.robot_id === id);
    const last = Math.max(...own.map((set) => Date.parse(set.measured_at ?? set.created_at)));
    return [
      ...new Set(own.flatMap(({ serial_number }) => serial_number ?? [])),
      text.lists.jointCount(joints.length),
      own.length > 0 ? text.lists.measuredOn(dayText(last)) : text.lists.addedOn(dayText(created_at)),
    ];
  });

/** The robot that a file brings along, among those to choose from. */
export const FROM_FILE = "file";

/** Robots to choose from, after none, and that of a file. */
export const robotOptions = (names: Names | null, none: string, ofFile?: { name?: unknown } | null) => [
  { value: "", label: none },
  ...(ofFile ? [{ value: FROM_FILE, label: text.start.fromFile(String(ofFile.name ?? "")) }] : []),
  ...(names?.robots ?? []).map(({ id }) => ({ value: id, label: names?.robot(id) ?? id })),
];

/** The robot of a choice, that of a file or a stored one. */
export const sourceOf = (chosen: string | undefined, ofFile: RobotDocument | null | undefined): RobotSource | null =>
  chosen === FROM_FILE ? (ofFile ? { robot: ofFile } : null) : chosen ? { robot_id: chosen } : null;

/** Sets to choose from, with their robots. */
export const setOptions = (names: Names) =>
  names.sets.map(({ id, robot_id: robot }) => ({ value: id, label: `${names.set(id)} (${names.robot(robot)})` }));

export interface Drawn {
  kinematics: Posture[] | null;
  problem: Problem | null;
}

/** Kinematics of a source in some configurations; while a new answer is on its way the last one stays. */
export function useKinematics(source: RobotSource | null, joints: number[][]): Drawn {
  const [drawn, set] = useState<Drawn>({ kinematics: null, problem: null });
  const wanted = useRef<string | null>(null);
  const asking = useRef(false);
  const question = source && JSON.stringify([source, joints]);
  useEffect(() => {
    wanted.current = question;
    if (question === null) set({ kinematics: null, problem: null });
    else void ask();
    return () => {
      wanted.current = null;
    };
  }, [question]);
  useEffect(() => listen(window, { online: () => void ask() }), []); // what was asked while the network was away

  async function ask(): Promise<void> {
    if (asking.current) return;
    asking.current = true;
    for (let asked: string | null = null; wanted.current !== null && wanted.current !== asked; ) {
      asked = wanted.current;
      const [from, angles] = JSON.parse(asked) as [RobotSource, number[][]];
      const answer: Drawn = await api.kinematics(from, angles).then(
        (kinematics) => ({ kinematics, problem: null }),
        (error: unknown) => ({ kinematics: null, problem: problemOf(error) }),
      );
      if (wanted.current !== null) set((last) => ({ ...answer, kinematics: answer.kinematics ?? last.kinematics }));
    }
    asking.current = false;
  }
  return drawn;
}
