/** What a button deletes, and an undo that brings it back. */
import { problemOf } from "../api/client";
import { text } from "../i18n";
import { type Action, useAction } from "./action";
import { go } from "./router";
import { toast } from "./toasts";

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
