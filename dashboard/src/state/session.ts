/** Who is signed in on this device. The key itself is in a cookie that no script can read. */
import { createContext } from "preact";
import { useEffect, useState } from "preact/hooks";
import { api, onRefused } from "../api/client";
import type { Session } from "../api/types";
import { keep } from "./kept";

/** `unknown` until the service says; `away` if it does not: views say why. */
export type Standing = Session | "unknown" | "away";

/** Whether the key is a viewer's, who may look but not begin, change or delete anything. */
export const Viewer = createContext(false);

export const isViewer = (session: Standing): boolean => typeof session === "object" && session.role === "viewer";

/** Whether a key has to be entered before anything can be seen. */
export const needsKey = (session: Standing): boolean =>
  typeof session === "object" && session.access === "keys" && session.key_id === null;

/** Who is signed in, and how to say that it changed; an answer that a key is needed asks the service again. */
export function useSession(): [Standing, (session: Session) => void] {
  const [session, set] = useState<Standing>("unknown");
  useEffect(() => {
    const ask = () => void api.session().then(set, () => set((before) => (before === "unknown" ? "away" : before)));
    ask();
    return onRefused(ask);
  }, []);
  return [session, set];
}

/** End the session of this device, and forget all that was shown. */
export async function signOut(): Promise<void> {
  await api.signOut();
  await keep("files", null);
  location.reload();
}
