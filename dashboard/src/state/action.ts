/** Something that a button starts: busy while it goes on, and its problem if it fails. */
import { useCallback, useRef, useState } from "preact/hooks";
import { problemOf } from "../api/client";
import type { Problem, Usability } from "../api/types";
import { text } from "../i18n";
import { go } from "./router";
import { toast } from "./toasts";

/** Type of the problem of a result that is not to be used. */
const NOT_TO_BE_USED = "urn:jointstiff:problem:not-to-be-used";

/** Post; where the verdict is in the way, ask, and post again with it accepted. */
export async function asking<Made>(post: (accepted: { accept_verdict?: Usability }) => Promise<Made>): Promise<Made> {
  try {
    return await post({});
  } catch (error) {
    const { type, errors } = problemOf(error);
    if (type !== NOT_TO_BE_USED || !confirm(text.assessment.sure(errors.map(({ reason }) => reason)))) throw error;
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
  const [busy, setBusy] = useState(false);
  const [problem, setProblem] = useState<Problem | null>(null);
  const going = useRef(false);
  const run = useCallback(
    (...args: Arguments) => {
      if (going.current) return;
      going.current = true;
      setBusy(true);
      setProblem(null);
      const begun = performance.now();
      const here = location.hash;
      act(...args)
        .then((made) => {
          if (timed) tooks.set(timed, (performance.now() - begun) / 1e3);
          if (typeof made !== "string") return;
          if (location.hash === here) go(made);
          else toast(text.app.done, { label: text.app.show, run: () => go(made) });
        })
        .catch((error: unknown) => setProblem(problemOf(error)))
        .finally(() => {
          going.current = false;
          setBusy(false);
        });
    },
    [act],
  );
  return { run, busy, problem, took: tooks.get(timed) ?? null };
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
    void restore().then(
      () => go(here),
      (error: unknown) => toast(problemOf(error).detail),
    );
  return useAction(async () => {
    await remove();
    if (location.hash === here) go(list);
    toast(deleted, { label: text.runs.undo, run: bringBack });
  });
}
