/** Where one is, what a button starts, and the messages that say what came of it. */
import { useEffect, useRef, useState } from "preact/hooks";
import { problemOf } from "../api/problem";
import type { Problem, Usability } from "../api/types";
import { listen, news, tell } from "../lib/events";
import { text } from "../words";
import { send, useMutation } from "./query";
import { askFor, sure } from "./question";

export interface Route {
  parts: string[];
  query: URLSearchParams;
}

export function parse(hash: string): Route {
  const [path = "", search = ""] = hash.replace(/^#/, "").split("?", 2);
  return { parts: path.split("/").filter(Boolean).map(decode), query: new URLSearchParams(search) };
}

function decode(part: string): string {
  try {
    return decodeURIComponent(part);
  } catch {
    return part;
  }
}

/** A link inside the page. */
export function link(parts: string[], query: Record<string, string> = {}): string {
  const search = new URLSearchParams(query).toString();
  return `#/${parts.map(encodeURIComponent).join("/")}${search && `?${search}`}`;
}

export function go(address: string): void {
  location.hash = address;
}

let navigated = false;

/** Whether one came to this view from another, rather than from outside. */
export const hasNavigated = (): boolean => navigated;

export function useRoute(): Route {
  const [route, set] = useState(() => parse(location.hash));
  const read = () => set(parse(location.hash));
  useEffect(() => {
    const hear = () => {
      navigated = true;
      read();
    };
    return listen(window, { hashchange: hear });
  }, []);
  useEffect(() => listen(news, { readdressed: read }), []);
  return route;
}

/** Give the view that is shown another search in its address, without a step of the browser's history. */
export function readdress(change: (now: URLSearchParams) => Record<string, string>): void {
  const { parts, query } = parse(location.hash);
  history.replaceState(history.state, "", link(parts, change(query)));
  tell("readdressed");
}

interface Toast {
  id: number;
  message: string;
  action?: { label: string; run: () => void };
}

let toasts: Toast[] = [];
let count = 0;

function show(next: Toast[]): void {
  toasts = next;
  tell("toasts");
}

/** Show a message; with something to do it stays longer. */
export function toast(message: string, action?: Toast["action"]): void {
  const id = ++count;
  show([...toasts.slice(-2), action ? { id, message, action } : { id, message }]);
  setTimeout(() => dismiss(id), action ? 20_000 : 5_000);
}

/** Copy a text, and say so; where there is no clipboard, as on plain http, it is shown to be copied. */
export function copied(content: string, label: string, said: string): void {
  if (!navigator.clipboard) void askFor(label, content);
  else void navigator.clipboard.writeText(content).then(() => toast(said));
}

export function dismiss(id: number): void {
  show(toasts.filter((shown) => shown.id !== id));
}

export function useToasts(): Toast[] {
  const [shown, set] = useState(toasts);
  useEffect(() => listen(news, { toasts: () => set(toasts) }), []);
  return shown;
}

/** Type of the problem of a result that is not to be used. */
const NOT_TO_BE_USED = "urn:jointstiff:problem:not-to-be-used";

/** Post; where the verdict is in the way, ask, and post again with it accepted. */
export async function asking<Made>(post: (accepted: { accept_verdict?: Usability }) => Promise<Made>): Promise<Made> {
  try {
    return await post({});
  } catch (error) {
    const { type, errors } = problemOf(error);
    if (type !== NOT_TO_BE_USED || !(await sure(text.assessment.sure(errors.map(({ reason }) => reason))))) throw error;
    return post({ accept_verdict: "do_not_use" });
  }
}

export interface Action<Arguments extends unknown[]> {
  run: (...args: Arguments) => void;
  busy: boolean;
  problem: Problem | null;
  /** Seconds that it took the last time; null where that is unknown. */
  took?: number | null;
}

const tooks = new Map<string, number>();

/**
 * A second start while the first goes on does nothing: gloves tap twice. An action may answer with the address of what
 * it made: one is brought there, or told of it if one has left the view meanwhile.
 */
export function useAction<Arguments extends unknown[]>(
  act: (...args: Arguments) => Promise<unknown>,
  timed = "",
): Action<Arguments> {
  const { busy, problem, start } = useMutation(act);
  const run = (...args: Arguments) => {
    const begun = performance.now();
    const here = location.hash;
    const shown = (made: unknown) => {
      if (timed) tooks.set(timed, (performance.now() - begun) / 1e3);
      if (typeof made !== "string") return;
      if (location.hash === here) go(made);
      else toast(text.app.done, { label: text.app.show, run: () => go(made) });
    };
    void start(...args)?.then(shown, () => undefined); // the view shows the problem
  };
  return { run, busy, problem, took: tooks.get(timed) ?? null };
}

/** Calls that follow a hand: one at a time, and after it the latest of those that came meanwhile. */
export function useLatest<Value>(act: (value: Value) => Promise<unknown>): {
  run: (value: Value) => void;
  problem: Problem | null;
} {
  const waiting = useRef<{ value: Value } | null>(null);
  const isRunning = useRef(false);
  const [problem, setProblem] = useState<Problem | null>(null);
  const run = async (value: Value) => {
    waiting.current = { value };
    if (isRunning.current) return;
    isRunning.current = true;
    while (waiting.current) {
      const next: Value = waiting.current.value;
      waiting.current = null;
      try {
        await act(next);
        setProblem(null);
      } catch (error) {
        setProblem(problemOf(error)); // the value that came meanwhile is called all the same
      }
    }
    isRunning.current = false;
  };
  return { run: (value) => void run(value), problem };
}

interface Deletable {
  remove: () => Promise<unknown>;
  restore: () => Promise<unknown>;
  /** Address of the list that it stands in, where one goes afterwards. */
  list: string;
  /** Said afterwards. */
  deleted: string;
}

export function useDeletion({ remove, restore, list, deleted }: Deletable): Action<[]> {
  const here = location.hash;
  const bringBack = () =>
    void send(restore).then(
      () => go(here),
      (error: unknown) => toast(problemOf(error).detail),
    );
  return useAction(async () => {
    await remove();
    if (location.hash === here) go(list);
    toast(deleted, { label: text.runs.undo, run: bringBack });
  });
}
