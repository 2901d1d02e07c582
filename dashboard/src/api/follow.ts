/** Jobs as they go on, by the server-sent events of the service. */
import { listen } from "../lib/events";
import type { Progress, RunState } from "./types";

export interface Standing {
  id: string;
  state: RunState;
  progress: Progress | null;
}

/**
 * Follow a job; `step` is called with every step, and with `ended` true for the last; `away` is called when the
 * service cannot be reached, and when it can again: the browser tries by itself. Returns a function that stops.
 */
export function follow(
  id: string,
  step: (standing: Standing, ended: boolean) => void,
  away?: (isAway: boolean) => void,
): () => void {
  const source = new EventSource(`/v1/jobs/${encodeURIComponent(id)}/events`);
  const hear = (ended: boolean) => (event: MessageEvent<string>) => {
    if (ended) source.close(); // else the browser would come back and hear it again
    step(JSON.parse(event.data) as Standing, ended);
  };
  listen(source, { open: () => away?.(false), error: () => away?.(true), progress: hear(false), end: hear(true) });
  return () => source.close();
}

export const goesOn = (state: RunState): boolean => state === "queued" || state === "running";
