/**
 * Readings of open sets on their way to the service: mutations, each kept on this device under a key of its own until
 * the service has it. They are sent from any view, one after the other within a set, as soon as the service is back.
 */
import { dehydrate, type DehydratedState, hydrate, type Mutation } from "@tanstack/query-core";
import { useEffect, useLayoutEffect, useReducer } from "preact/hooks";
import { api } from "../../api/calls";
import { ApiError, isAway, problemOf } from "../../api/problem";
import { queries } from "../../api/queries";
import type { LiveState, Observation, Problem } from "../../api/types";
import { listen } from "../../lib/events";
import { freshKey } from "../../lib/json";
import { isUnstored, recalled, remember, remembered } from "../../state/kept";
import { client, onDevice } from "../../state/query";

const KEY = ["reading"];
const AGAIN_MS = 3_000;

interface Reading {
  /** Under which the reading is kept; keys are in the order in which the readings came. */
  key: string;
  set: string;
  observation: Observation;
}

type Sent = Mutation<LiveState | null, Error, Reading>;

/** A reading that the service does not have yet. */
export interface Waiting {
  key: string;
  observation: Observation;
  /** Why the service refused it; null while it is on its way. */
  problem: Problem | null;
}

client.setMutationDefaults(KEY, {
  mutationFn: async (reading) => {
    const { key, set, observation } = reading as unknown as Reading;
    if (recalled(key) === null) return null; // another tab has sent it, or it was discarded
    try {
      return await api.openSets.observe(set, observation);
    } catch (error) {
      if (!isAway(error) && recalled(key) === null) return null;
      throw error;
    }
  },
  retry: (_, error) => isAway(error),
  retryDelay: AGAIN_MS,
  networkMode: "always", // a service on this machine is reachable while the browser is offline
  gcTime: Number.POSITIVE_INFINITY,
});

const mutations = client.getMutationCache();
const isReading = (mutation: { options: { mutationKey?: readonly unknown[] } }): boolean =>
  mutation.options.mutationKey?.[0] === KEY[0];
const readings = (): Sent[] => mutations.getAll().filter(isReading) as unknown as Sent[];

mutations.subscribe(({ type, mutation, ...event }) => {
  if (type !== "updated" || !mutation || !isReading(mutation)) return;
  const { key, set } = mutation.state.variables as Reading;
  const action = (event as { action: { type: string; data?: LiveState | null } }).action;
  if (action.type === "pending" || action.type === "error") {
    const only = { shouldDehydrateMutation: (one: unknown) => one === mutation, shouldDehydrateQuery: () => false };
    remember(key, dehydrate(client, only).mutations[0]);
  } else if (action.type === "success") {
    remember(key, null);
    if (action.data) putState(set, action.data);
    mutations.remove(mutation);
  }
});

/** Take the state of an open set, unless a newer one is known; it stays on this device. */
export function putState(set: string, state: LiveState): void {
  const { queryKey } = queries.liveState(set);
  client.setQueryData<LiveState>(queryKey, (before) => (before && before.revision > state.revision ? before : state));
  void onDevice.persistQueryByKey(queryKey, client);
}

/** Take the readings that this device keeps, of this tab and of others, and send those that are not refused. */
export function resumeReadings(): void {
  const known = new Set(readings().map(({ state }) => state.variables?.key));
  for (const name of remembered("reading.")) {
    const kept = recalled(name) as DehydratedState["mutations"][number] | null;
    if (!kept || known.has(name)) continue;
    const { status, error } = kept.state;
    const problem = (error as { problem?: Problem } | null)?.problem;
    const state = {
      ...kept.state,
      error: problem ? new ApiError(problem) : error,
      isPaused: status === "pending",
    };
    hydrate(client, { mutations: [{ ...kept, state }], queries: [] });
  }
  void client.resumePausedMutations();
}

/** Begin to send what waits, and go on when another tab keeps a reading. */
export function startReadings(): void {
  client.mount();
  resumeReadings();
  listen(window, {
    storage: ({ key }: StorageEvent) => key?.startsWith("jointstiff.reading.") && resumeReadings(),
  });
}

/** The readings of an open set that wait, in the order in which they came. */
export const waitingOf = (set: string): Waiting[] =>
  readings().flatMap(({ state: { variables, error, status } }) =>
    variables?.set === set && status !== "success" && recalled(variables.key) !== null
      ? [{ key: variables.key, observation: variables.observation, problem: error && problemOf(error) }]
      : [],
  );

let count = 0;
/** A key that no other reading has, in no tab; keys of one tab are in order. */
const freshKeyOf = (set: string): string =>
  `reading.${set}.${String(Date.now()).padStart(15, "0")}.${String(count++).padStart(6, "0")}.${freshKey("one")}`;

/** Keep readings, and send them one after the other. */
export function sendReadings(set: string, observations: Observation[]): void {
  for (const observation of observations)
    void mutations
      .build(client, client.defaultMutationOptions({ mutationKey: KEY, scope: { id: set } }))
      .execute({ key: freshKeyOf(set), set, observation })
      .catch(() => undefined); // the view of the set says why the service refused it
}

/** Discard the waiting readings with a label. */
export function discardReading(set: string, label: string): void {
  for (const mutation of readings()) {
    const { variables } = mutation.state;
    if (variables?.set !== set || variables.observation.label !== label) continue;
    remember(variables.key, null);
    mutations.remove(mutation);
  }
}

export interface Waits {
  waiting: Waiting[];
  /** Whether the service cannot be reached with them. */
  away: boolean;
  /** Whether some of them are gone when the page is left, as storage is switched off or full. */
  unstored: boolean;
}

/** The readings of an open set that wait, as they change. */
export function useWaiting(set: string): Waits {
  const [, draw] = useReducer((drawn: number) => drawn + 1, 0);
  useLayoutEffect(() => mutations.subscribe(({ mutation }) => mutation && isReading(mutation) && draw(undefined)), []);
  const waiting = waitingOf(set);
  const away = readings().some(
    ({ state }) => state.variables?.set === set && state.status === "pending" && state.failureCount > 0,
  );
  const unstored = waiting.some(({ key }) => isUnstored(key));
  useEffect(() => {
    if (!unstored) return undefined;
    const refuse = (event: BeforeUnloadEvent) => event.preventDefault(); // the browser asks whether to leave
    window.addEventListener("beforeunload", refuse);
    return () => window.removeEventListener("beforeunload", refuse);
  }, [unstored]);
  return { waiting, away, unstored };
}
