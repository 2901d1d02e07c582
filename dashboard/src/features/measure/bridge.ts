/** The bridge from a tracker to the form of an open set: paired by a code, and kept while this tab is open. */
import { useEffect, useRef, useState } from "preact/hooks";
import { api } from "../../api/calls";
import { isAway, problemOf } from "../../api/problem";
import type { BridgeReading, BridgeStand, BridgeState, Paired } from "../../api/types";
import { listen } from "../../lib/events";
import type { Typed } from "./live";
import { recalled, remember } from "../../state/kept";

const AGAIN_MS = 3_000;
const NOT_FOUND = 404;

export interface Bridge {
  /** The bridge that this tab has opened; null without one. */
  paired: Paired | null;
  /** What the service says of it; null while that is unknown. */
  state: BridgeState | null;
  open: () => Promise<void>;
  end: () => Promise<void>;
  /** The target of each other name that the tracker sends; null: the name is left out. */
  names: Record<string, string | null>;
  rename: (names: Record<string, string | null>) => void;
}

/** The bridge of this tab to the form of an open set. It ends when the set is closed. */
export function useBridge(set: string, closed: boolean): Bridge {
  const name = `measure.${set}.bridge`;
  const [paired, setPaired] = useState(() => recalled(name, "sessionStorage") as Paired | null);
  const [state, setState] = useState<BridgeState | null>(null);
  const [names, setNames] = useState(() => (recalled(`${name}.names`, "sessionStorage") ?? {}) as Bridge["names"]);
  const id = paired?.id;
  const rename = (next: Bridge["names"]) => {
    remember(`${name}.names`, next, "sessionStorage");
    setNames(next);
  };
  const put = (next: Paired | null) => {
    if (next === null) rename({});
    remember(name, next, "sessionStorage");
    setState(null);
    setPaired(next);
  };
  const end = async () => {
    put(null);
    if (id) await api.bridges.end(id).catch(() => undefined); // it ends by itself, too
  };
  useEffect(() => {
    if (!id) return undefined;
    if (!closed) return follow(id, setState, () => put(null));
    void end();
    return undefined;
  }, [id, closed]);
  return { paired, state, open: async () => put(await api.bridges.open(set)), end, names, rename };
}

/** Follow a bridge until it has ended; returns a function that stops. */
function follow(id: string, hear: (state: BridgeState) => void, ended: () => void): () => void {
  const open = () => {
    const made = new EventSource(api.bridges.followed(id));
    listen(made, {
      bridge: (event: MessageEvent<string>) => hear(JSON.parse(event.data) as BridgeState),
      end: () => {
        stop();
        ended();
      },
    });
    return made;
  };
  let source = open();
  // A browser gives up a stream that was refused: it is opened again unless the bridge has ended.
  const look = async () => {
    if (source.readyState !== EventSource.CLOSED) return;
    const gone = await api.bridges.check(id).then(
      () => false,
      (error: unknown) => problemOf(error).status === NOT_FOUND,
    );
    if (isStopped) return;
    if (gone) {
      stop();
      ended();
    } else if (source.readyState === EventSource.CLOSED) source = open();
  };
  const timer = setInterval(() => void look(), AGAIN_MS);
  let isStopped = false;
  const stop = () => {
    isStopped = true;
    source.close();
    clearInterval(timer);
  };
  return stop;
}

/**
 * Ask the tracker for positions in a stand and a column of the form, and hand them on as they come. The answer says
 * what the tracker reads there; null without a tracker.
 */
export function useTracked(
  { paired, state, names }: Bridge,
  stand: Omit<BridgeStand, "number" | "loaded" | "names">,
  column: keyof Typed,
  take: (reading: BridgeReading) => void,
): BridgeReading | null {
  const number = useRef(0);
  const id = state?.joined ? paired?.id : undefined;
  const wanted = JSON.stringify([id, stand, column, names]);
  useEffect(() => {
    if (!id) return undefined;
    // Numbers grow, also over tabs and reloads, so that no position of an earlier stand counts.
    number.current = Math.max(Date.now(), number.current + 1);
    const asked = { ...stand, number: number.current, loaded: column === "loaded", names };
    let timer: ReturnType<typeof setTimeout> | undefined;
    const show = (): unknown =>
      api.bridges.show(id, asked).catch((error: unknown) => {
        if (isAway(error) && number.current === asked.number) timer = setTimeout(show, AGAIN_MS);
      });
    void show();
    return () => clearTimeout(timer);
  }, [wanted]);
  const reading = id && state?.reading.number === number.current ? state.reading : null;
  const read = JSON.stringify(reading);
  useEffect(() => {
    if (reading) take(reading);
  }, [read]);
  return id ? (reading ?? { number: null, points: {}, unknown: {}, trouble: null }) : null;
}
