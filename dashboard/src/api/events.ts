/** Following a job that goes on: server-sent events of its progress, then one of its end. */
import type { Progress, RunState } from "./types";

export interface Standing {
  id: string;
  state: RunState;
  progress: Progress | null;
}

/** Kinds of work, as the API names them. */
export type Collection = "runs" | "comparisons" | "geometries" | "plans" | "maps" | "programs";

/**
 * Follow a job; `tell` hears every step, and `ended` true of the last; `away` hears when the service cannot be
 * reached, and when it can again: the browser tries by itself. Answers with how to stop.
 */
export function follow(
  id: string,
  tell: (standing: Standing, ended: boolean) => void,
  away?: (isAway: boolean) => void,
): () => void {
  const source = new EventSource(`/v1/jobs/${encodeURIComponent(id)}/events`);
  const hear = (ended: boolean) => (event: MessageEvent<string>) => {
    if (ended) source.close(); // else the browser would come back and hear it again
    tell(JSON.parse(event.data) as Standing, ended);
  };
  source.addEventListener("open", () => away?.(false));
  source.addEventListener("error", () => away?.(true));
  source.addEventListener("progress", hear(false));
  source.addEventListener("end", hear(true));
  return () => source.close();
}

export const goesOn = (state: RunState): boolean => state === "queued" || state === "running";
