/** An open set while it is measured: its state as it changes, and readings that wait for the service in this browser. */
import { useEffect, useRef, useState } from "preact/hooks";
import { api, problemOf } from "../api/client";
import type { LiveState, Observation, Problem } from "../api/types";
import { listen } from "../lib/events";
import { freshKey } from "../lib/json";
import { isUnstored, recalled, remember, remembered } from "./session";

/** A reading on its way, kept under a key of its own, so that no tab overwrites another's; with what the service has against it. */
export interface Waiting {
  key: string;
  observation: Observation;
  problem: Problem | null;
}

export interface Measuring {
  state: LiveState;
  /** Whether the service cannot be reached. */
  away: boolean;
  waiting: Waiting[];
  /** Whether some of them are gone when the page is left, as storage is switched off or full. */
  unstored: boolean;
  put: (state: LiveState) => void;
  send: (...observations: Observation[]) => void;
  /** Send a waiting reading under another label, or discard it. */
  resend: (label: string, as: string | null) => void;
}

const AGAIN_MS = 3_000;

export function useMeasuring(id: string, first: LiveState): Measuring {
  const [state, setState] = useState(first);
  const [away, setAway] = useState(false);
  const [waiting, setWaiting] = useState(() => waitingOf(id));
  const going = useRef(false);
  const keep = (...changed: (Waiting | string)[]) => {
    for (const one of changed) typeof one === "string" ? remember(one, null) : remember(one.key, one);
    setWaiting(waitingOf(id));
  };
  const put = (next: LiveState) => setState((before) => (next.revision >= before.revision ? next : before));
  const flush = async () => {
    if (going.current) return;
    going.current = true;
    for (let next = unsent(id); next; next = unsent(id)) {
      try {
        put(await api.openSets.observe(id, next.observation));
        setAway(false);
        keep(next.key);
      } catch (error) {
        const problem = problemOf(error);
        if (problem.status === 0 || problem.status >= 500 || problem.status === 429) {
          setAway(true);
          break;
        }
        if (recalled(next.key) === null) continue; // another tab has sent it
        keep({ ...next, problem });
      }
    }
    going.current = false;
  };
  const send = (...observations: Observation[]) => {
    keep(...observations.map((observation) => ({ key: freshKeyOf(id), observation, problem: null })));
    void flush();
  };
  const resend = (label: string, as: string | null) => {
    const changed = waitingOf(id).filter(({ observation }) => observation.label === label);
    keep(
      ...changed.map((one) =>
        as === null ? one.key : { ...one, observation: { ...one.observation, label: as }, problem: null },
      ),
    );
    void flush();
  };
  useEffect(() => {
    if (state.state === "closed") return undefined;
    const back = () => {
      setAway(false);
      void flush();
    };
    let source = followed(id, put, back, () => setAway(true));
    const timer = setInterval(() => {
      if (source.readyState === EventSource.CLOSED) source = followed(id, put, back, () => setAway(true));
      void flush();
    }, AGAIN_MS);
    const stop = listen(window, { online: back, storage: () => setWaiting(waitingOf(id)) });
    return () => {
      source.close();
      clearInterval(timer);
      stop();
    };
  }, [id, state.state === "closed"]);
  const unstored = waiting.some(({ key }) => isUnstored(key));
  useEffect(() => {
    if (!unstored) return undefined;
    const ask = (event: BeforeUnloadEvent) => event.preventDefault(); // the browser asks whether to leave
    window.addEventListener("beforeunload", ask);
    return () => window.removeEventListener("beforeunload", ask);
  }, [unstored]);
  return { state, away, waiting, unstored, put, send, resend };
}

const unsent = (id: string): Waiting | undefined => waitingOf(id).find(({ problem }) => problem === null);

/** The readings of an open set that wait in this browser, of all its tabs, in the order in which they came. */
export const waitingOf = (id: string): Waiting[] =>
  remembered(`${keyOf(id)}.`).flatMap((key) => {
    const one = recalled(key) as Waiting | null;
    return one ? [one] : [];
  });

let sent = 0;
/** A key that no other reading has, in no tab; keys of one tab are in order. */
const freshKeyOf = (id: string): string =>
  `${keyOf(id)}.${String(Date.now()).padStart(15, "0")}.${String(sent++).padStart(6, "0")}.${freshKey("reading")}`;

function followed(id: string, put: (state: LiveState) => void, back: () => void, gone: () => void): EventSource {
  const source = new EventSource(api.openSets.followed(id));
  const hear = (event: MessageEvent<string>) => {
    const state = JSON.parse(event.data) as LiveState;
    if (state.state === "closed") source.close(); // else the browser would come back and hear it again
    put(state);
  };
  listen(source, { open: back, error: gone, state: hear });
  return source;
}

const keyOf = (id: string): string => `measure.${id}.waiting`;
export const draftKey = (id: string): string => `measure.${id}.draft`;

/** Labels that count although a mistake shows in them, or showed when they came; `named`: those in which it shows now. */
export function keptIn({ readings, assessment, warnings }: Pick<LiveState, "readings" | "assessment" | "warnings">) {
  const found = [...(assessment?.reasons ?? []), ...warnings].filter(({ weight }) => weight === "do_not_use");
  const wrong = readings.some(({ state }) => state === "doubtful") ? [] : found.map((each) => each.observation);
  const counting = readings.filter(({ state }) => state === "counts");
  const kept = counting.flatMap(({ label, doubtful }) => (doubtful || wrong.includes(label) ? [label] : []));
  return { kept, named: kept.filter((label) => wrong.includes(label)) };
}
