/** A run with stated options, awaited. */
import { api } from "../../api/calls";
import { goesOn } from "../../api/follow";
import type { Run } from "../../api/types";
import { contentKey, freshKey } from "../../lib/json";

const LOOK_AGAIN = 300;

export type RunOptions = Partial<Run["request"]> & { measurement_set_id: string };

/** A run once it has ended; the same options give the same run. */
export async function identified(options: RunOptions): Promise<Run> {
  const known = await api.runs.add(options, contentKey("run", options));
  // one that was deleted meanwhile is made again
  let run = await api.runs.one(known.id).catch(() => api.runs.add(options, freshKey("run")));
  while (goesOn(run.state)) {
    await new Promise((ready) => setTimeout(ready, LOOK_AGAIN));
    run = await api.runs.one(run.id);
  }
  return run;
}
