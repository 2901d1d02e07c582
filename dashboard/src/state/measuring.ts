/** An open set while it is measured: its state as it changes, and readings that wait for the service in this browser. */
import { useEffect, useRef, useState } from "preact/hooks";
import { api, problemOf } from "../api/client";
import type { LiveState, Observation, Problem } from "../api/types";
import { listen } from "../lib/events";
import { recalled, remember } from "./session";

/** A reading on its way; with what the service has against it. */
export interface Waiting {
  observation: Observation;
  problem: Problem | null;
}

export interface Measuring {
  state: LiveState;
  /** Whether the service cannot be reached. */
  away: boolean;
  waiting: Waiting[];
  put: (state: LiveState) => void;
  send: (...observations: Observation[]) => void;
  /** Send a waiting reading under another label, or discard it. */
  resend: (label: string, as: string | null) => void;
}

const AGAIN_MS = 3_000;

export function useMeasuring(id: string, first: LiveState): Measuring {
  const [state, setState] = useState(first);
  const [away, setAway] = useState(false);
  const [waiting, setWaiting] = useState(() => (recalled(keyOf(id)) ?? []) as Waiting[]);
  const queue = useRef(waiting);
  const going = useRef(false);
  const change = (next: Waiting[]) => {
    queue.current = next;
    remember(keyOf(id), next.length > 0 ? next : null);
    setWaiting(next);
  };
  const put = (next: LiveState) => setState((before) => (next.revision >= before.revision ? next : before));
  const flush = async () => {
    if (going.current) return;
    going.current = true;
    for (let next = unsent(queue.current); next; next = unsent(queue.current)) {
      const sent = next;
      try {
        put(await api.openSets.observe(id, sent.observation));
        setAway(false);
        change(queue.current.filter((each) => each !== sent));
      } catch (error) {
        const problem = problemOf(error);
        if (problem.status === 0 || problem.status >= 500 || problem.status === 429) {
          setAway(true);
          break;
        }
        change(queue.current.map((each) => (each === sent ? { ...sent, problem } : each)));
      }
    }
    going.current = false;
  };
  const send = (...observations: Observation[]) => {
    change([...queue.current, ...observations.map((observation) => ({ observation, problem: null }))]);
    void flush();
  };
  const resend = (label: string, as: string | null) => {
    const anew = ({ observation }: Waiting): Waiting[] =>
      as === null ? [] : [{ observation: { ...observation, label: as }, problem: null }];
    change(queue.current.flatMap((each) => (each.observation.label === label ? anew(each) : [each])));
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
    const stop = listen(window, { online: back });
    return () => {
      source.close();
      clearInterval(timer);
      stop();
    };
  }, [id, state.state === "closed"]);
  return { state, away, waiting, put, send, resend };
}

const unsent = (queue: Waiting[]): Waiting | undefined => queue.find(({ problem }) => problem === null);

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

const keyOf = (id: string): string => `measure.${id}`;
export const draftKey = (id: string): string => `measure.${id}.draft`;

/** Labels that count although a mistake shows in them, or showed when they came; `named`: those in which it shows now. */
export function keptIn({ readings, assessment, warnings }: Pick<LiveState, "readings" | "assessment" | "warnings">) {
  const found = [...(assessment?.reasons ?? []), ...warnings].filter(({ weight }) => weight === "do_not_use");
  const wrong = readings.some(({ state }) => state === "doubtful") ? [] : found.map((each) => each.observation);
  const counting = readings.filter(({ state }) => state === "counts");
  const kept = counting.flatMap(({ label, innovation: of }) => (of?.doubtful || wrong.includes(label) ? [label] : []));
  return { kept, named: kept.filter((label) => wrong.includes(label)) };
}
