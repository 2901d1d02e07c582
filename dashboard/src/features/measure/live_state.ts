/** An open set while it is measured: its state as it changes, and what is kept of it on this device. */
import { useEffect, useState } from "preact/hooks";
import { api } from "../../api/calls";
import type { LiveState } from "../../api/types";
import { listen } from "../../lib/events";
import { putState, resumeReadings } from "./readings";

const AGAIN_MS = 3_000;

/** Follow the state of an open set. Returns whether the service cannot be reached. */
export function useFollowed(set: string, closed: boolean): boolean {
  const [away, setAway] = useState(false);
  useEffect(() => {
    if (closed) return setAway(false);
    const back = () => {
      setAway(false);
      resumeReadings();
    };
    let source = follow(set, back, () => setAway(true));
    // A browser gives up a stream that was refused.
    const timer = setInterval(() => {
      if (source.readyState === EventSource.CLOSED) source = follow(set, back, () => setAway(true));
    }, AGAIN_MS);
    return () => {
      source.close();
      clearInterval(timer);
    };
  }, [set, closed]);
  return away;
}

function follow(set: string, back: () => void, gone: () => void): EventSource {
  const source = new EventSource(api.openSets.followed(set));
  const hear = (event: MessageEvent<string>) => {
    const state = JSON.parse(event.data) as LiveState;
    if (state.state === "closed") source.close(); // else the browser would come back and hear it again
    putState(set, state);
  };
  listen(source, { open: back, error: gone, state: hear });
  return source;
}

export const draftKey = (id: string): string => `measure.${id}.draft`;

/** Labels that count although a mistake shows in them, or showed when they came; `named`: those in which it shows now. */
export function keptIn({ readings, assessment, warnings }: Pick<LiveState, "readings" | "assessment" | "warnings">) {
  const found = [...(assessment?.reasons ?? []), ...warnings].filter(({ weight }) => weight === "do_not_use");
  const wrong = readings.some(({ state }) => state === "doubtful") ? [] : found.map((each) => each.observation);
  const counting = readings.filter(({ state }) => state === "counts");
  const kept = counting.flatMap(({ label, doubtful }) => (doubtful || wrong.includes(label) ? [label] : []));
  return { kept, named: kept.filter((label) => wrong.includes(label)) };
}
