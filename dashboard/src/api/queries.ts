/** Queries of the service: their keys, how long their answers are fresh, and which of them stay on this device. */
import { client, onDevice, type PagesOptions, type QueryOptions } from "../state/query";
import { api, type JobQuery, type JobTable, type RobotQuery, type SetQuery } from "./calls";
import { goesOn } from "./follow";
import type * as of from "./types";

/** An answer that never changes. */
const FIXED = { staleTime: "static" } as const;
const query = <Value>(options: QueryOptions<Value>) => options;

/** A job never changes once it has ended. */
const freshJob = ({ state }: { state: { data: { state: of.RunState } | undefined } }): number =>
  state.data && !goesOn(state.data.state) ? Number.POSITIVE_INFINITY : 0;

export const queries = {
  session: query({ queryKey: ["session"], queryFn: () => api.session(), ...FIXED }),
  health: query({ queryKey: ["health"], queryFn: ({ signal }) => api.health(signal), staleTime: 0 }),
  schemas: query({ queryKey: ["schemas"], queryFn: () => api.schemas(), ...FIXED }),
  catalogue: query({ queryKey: ["catalogue"], queryFn: () => api.catalogue(), ...FIXED }),

  robots: (filters: RobotQuery) =>
    query({ queryKey: ["robots", filters], queryFn: ({ signal }) => api.robots.list(filters, signal) }),
  /** The robots with the worst arms. */
  worstRobots: (limit: number) => queries.robots({ sort: "worst", limit }),
  /** All robots page by page, the worst first. */
  everyRobot: {
    queryKey: ["robots", "worst"],
    queryFn: ({ pageParam: cursor, signal }) => api.robots.list({ sort: "worst", limit: 100, cursor }, signal),
    initialPageParam: null,
    getNextPageParam: ({ next }) => next,
  } satisfies PagesOptions<of.Page<of.RobotSummary>> as PagesOptions<of.Page<of.RobotSummary>>,
  robot: (id: string) => query({ queryKey: ["robot", id], queryFn: ({ signal }) => api.robots.one(id, signal) }),
  trend: (robot: string, filters: Record<string, string | null | undefined>) =>
    query({
      queryKey: ["trend", robot, filters],
      queryFn: ({ signal }) => api.robots.trend(robot, filters, signal),
    }),

  sets: (filters: SetQuery) =>
    query({ queryKey: ["sets", filters], queryFn: ({ signal }) => api.sets.list(filters, signal) }),
  /** Readings never change, but what is noted about them does. */
  set: (id: string) =>
    query({
      queryKey: ["set", id],
      queryFn: ({ signal }) => api.sets.one(id, signal),
      staleTime: Number.POSITIVE_INFINITY,
    }),
  /** A set that is measured live, with its robot. */
  openSet: (id: string) =>
    query({
      queryKey: ["live", id],
      queryFn: async ({ signal }) => {
        const set = await api.openSets.one(id, signal);
        return { set, robot: await client.fetchQuery(queries.robot(set.robot_id)) };
      },
      persister: onDevice.persisterFn,
    }),
  liveState: (id: string) =>
    query({
      queryKey: ["live", id, "state"],
      queryFn: ({ signal }) => api.openSets.state(id, signal),
      persister: onDevice.persisterFn,
    }),

  runs: (filters: JobQuery) =>
    query({ queryKey: ["runs", filters], queryFn: ({ signal }) => api.runs.list(filters, signal) }),
  run: (id: string) =>
    query({ queryKey: ["run", id], queryFn: ({ signal }) => api.runs.one(id, signal), staleTime: freshJob }),
  plan: (id: string) =>
    query({ queryKey: ["plan", id], queryFn: ({ signal }) => api.plans.one(id, signal), staleTime: freshJob }),
  geometries: (filters: JobQuery) =>
    query({ queryKey: ["geometries", filters], queryFn: ({ signal }) => api.geometries.list(filters, signal) }),
  tables: (job: string, view: Record<string, string>) =>
    query({ queryKey: ["tables", job, view], queryFn: ({ signal }) => api.tables(job, view, signal), ...FIXED }),
  table: (id: string, name: JobTable) =>
    query({ queryKey: ["table", id, name], queryFn: ({ signal }) => api.table(id, name, signal), ...FIXED }),
  /** Kinematics of a source in some configurations. */
  kinematics: (source: of.RobotSource | null, joints: number[][]) =>
    query<of.Posture[]>({
      queryKey: ["kinematics", source, joints],
      queryFn: ({ signal }) => (source ? api.kinematics(source, joints, signal) : Promise.resolve([])),
      gcTime: 60_000,
      ...FIXED,
    }),
};
