/** Server state: TanStack Query's client of the page, and its observers as hooks. */
import {
  type InfiniteData,
  InfiniteQueryObserver,
  type InfiniteQueryObserverOptions,
  MutationCache,
  MutationObserver,
  QueryClient,
  type QueryKey,
  QueryObserver,
  type QueryObserverOptions,
} from "@tanstack/query-core";
import { experimental_createQueryPersister as createPersister } from "@tanstack/query-persist-client-core";
import { useLayoutEffect, useReducer, useRef, useState } from "preact/hooks";
import { isAway, problemOf } from "../api/problem";
import type { Problem } from "../api/types";
import { keep, kept } from "./kept";

/** A call that failed because the service is away is sent again after this time, while one looks at the page. */
const AGAIN_MS = 4_000;
const KEPT_MS = 14 * 24 * 3600 * 1000;

export const client: QueryClient = new QueryClient({
  // Whatever was changed at the service may show anywhere: views ask again for what they show.
  mutationCache: new MutationCache({ onSuccess: () => void client.invalidateQueries() }),
  defaultOptions: {
    queries: {
      // A service on the same machine is reachable while the browser is offline, so that a call is always tried.
      networkMode: "always",
      retry: false,
      staleTime: 2_000,
      refetchInterval: ({ state }) => (isAway(state.error) ? AGAIN_MS : false),
    },
    mutations: { networkMode: "always" },
  },
});

const put = async (name: string, value: unknown): Promise<void> => void (await keep(name, value));

/** Keeps the answers of a query on this device, so that the page shows them without a network. */
export const onDevice = createPersister({
  storage: { getItem: kept<never>, setItem: put, removeItem: (name: string) => put(name, null) },
  serialize: (query) => query as never,
  deserialize: (query) => query as never,
  maxAge: KEPT_MS,
  prefix: "query",
});

/** A query whose answers stay on this device. */
export const keptOnDevice = <Value>(options: QueryOptions<Value>): QueryOptions<Value> => ({
  ...options,
  persister: onDevice.persisterFn,
});

/** What a view shows of a query. */
export interface Query<Value> {
  data: Value | undefined;
  /** Why there is no data. */
  problem: Problem | null;
  isFetching: boolean;
  /** Whether the data are those of an earlier question, which stand in. */
  isStand: boolean;
  refetch: () => void;
}

/** Whether a query has its first answer, or a problem instead. */
export const isKnown = ({ data, problem }: Pick<Query<unknown>, "data" | "problem">): boolean =>
  data !== undefined || problem !== null;

/** The options of a query whose data are shown as they came. */
export type QueryOptions<Value> = QueryObserverOptions<Value, Error, Value, Value, QueryKey>;

/** Draw again whenever an observer has news. */
function useNews(observer: { subscribe: (hear: () => void) => () => void }): void {
  const [, draw] = useReducer((count: number) => count + 1, 0);
  useLayoutEffect(() => observer.subscribe(() => draw(undefined)), [observer]);
}

/** A problem stays in view while the call is sent again. */
function useProblem(hash: string, status: string, error: Error | null): Problem | null {
  const last = useRef<{ hash: string; problem: Problem } | null>(null);
  if (error && status === "error") last.current = { hash, problem: problemOf(error) };
  else if (status === "success" || last.current?.hash !== hash) last.current = null;
  return last.current?.problem ?? null;
}

export function useQuery<Value>(options: QueryOptions<Value>): Query<Value> {
  const wanted = { ...client.defaultQueryOptions(options), _optimisticResults: "optimistic" as const };
  const [observer] = useState(() => new QueryObserver<Value, Error, Value, Value, QueryKey>(client, wanted));
  const result = observer.getOptimisticResult(wanted);
  useNews(observer);
  useLayoutEffect(() => observer.setOptions(wanted));
  const problem = useProblem(wanted.queryHash, result.status, result.error);
  return {
    data: result.data,
    problem: result.data === undefined ? problem : null,
    isFetching: result.isFetching,
    isStand: result.isPlaceholderData,
    refetch: () => void observer.refetch(),
  };
}

/** A query that comes page by page. */
export interface Pages<Page> extends Query<Page[]> {
  /** Fetch the next page; null if there is none. */
  more: (() => void) | null;
}

export type PagesOptions<Page> = InfiniteQueryObserverOptions<
  Page,
  Error,
  InfiniteData<Page, string | null>,
  QueryKey,
  string | null
>;

export function usePages<Page>(options: PagesOptions<Page>): Pages<Page> {
  const wanted = { ...client.defaultQueryOptions(options as never), _optimisticResults: "optimistic" } as never;
  const { queryHash } = wanted as { queryHash: string };
  const [observer] = useState(
    () =>
      new InfiniteQueryObserver<Page, Error, InfiniteData<Page, string | null>, QueryKey, string | null>(
        client,
        wanted,
      ),
  );
  const result = observer.getOptimisticResult(wanted);
  useNews(observer);
  useLayoutEffect(() => observer.setOptions(wanted));
  const problem = useProblem(queryHash, result.status, result.error);
  return {
    data: result.data?.pages,
    problem: result.data === undefined ? problem : null,
    isFetching: result.isFetching,
    isStand: result.isPlaceholderData,
    refetch: () => void observer.refetch(),
    more: result.hasNextPage ? () => void observer.fetchNextPage() : null,
  };
}

/** Fetch outside a view, or from what is fresh. */
export const ask = <Value>(options: QueryOptions<Value>): Promise<Value> => client.fetchQuery(options as never);

/** Send a change to the service once. */
export const send = <Answer>(change: () => Promise<Answer>): Promise<Answer> =>
  new MutationObserver(client, { mutationFn: change }).mutate();

export interface Sending<Arguments extends unknown[]> {
  busy: boolean;
  problem: Problem | null;
  /** Send a change; while one is on its way there is no second one: gloves tap twice. */
  start: (...args: Arguments) => Promise<unknown> | null;
}

export function useMutation<Arguments extends unknown[]>(
  change: (...args: Arguments) => Promise<unknown>,
): Sending<Arguments> {
  const latest = useRef(change);
  latest.current = change;
  const [observer] = useState(
    () => new MutationObserver<unknown, Error, Arguments>(client, { mutationFn: (args) => latest.current(...args) }),
  );
  useNews(observer);
  const { isPending, error } = observer.getCurrentResult();
  return {
    busy: isPending,
    problem: error && problemOf(error),
    start: (...args) => {
      return observer.getCurrentResult().isPending ? null : observer.mutate(args);
    },
  };
}
