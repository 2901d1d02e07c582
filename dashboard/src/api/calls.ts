/** Every call of the API that the page makes, typed by the service's own description; failures are problems with a remedy. */
import createClient, { type Middleware } from "openapi-fetch";
import { text } from "../words";
import { tell } from "../lib/events";
import { type Columns, jsonOf } from "../lib/json";
import type { Schemas } from "../lib/schema";
import { ApiError, isProblem, localProblem, unreadable } from "./problem";
import type { paths } from "./schema";
import type * as of from "./types";

const SESSION = "/v1/session";

const failures: Middleware = {
  async onResponse({ response, schemaPath }) {
    if (response.ok) return;
    const answer: unknown = await response.json().catch(() => null);
    if (response.status === 401 && schemaPath !== SESSION) tell("refused");
    throw isProblem(answer) ? new ApiError(answer) : unreadable(response.status);
  },
  onError({ error, request }) {
    if (error instanceof ApiError || request.signal.aborted) return undefined;
    return new ApiError(localProblem(text.errors.unreachable));
  },
};

type Query = Record<string, unknown>;

/** Values of a query without those that state nothing. */
function searchOf(values: Query): string {
  const pairs = Object.entries(values).filter(([, value]) => value !== null && value !== undefined && value !== "");
  return new URLSearchParams(pairs.map(([name, value]) => [name, String(value)])).toString();
}

const client = createClient<paths>({
  headers: { Accept: "application/json" },
  fetch: (request) => fetch(request),
  querySerializer: searchOf,
  bodySerializer: (body: unknown) => (body instanceof FormData || body instanceof Blob ? body : jsonOf(body)),
});
client.use(failures);

/** The message of an answer, which is named: the client's own types lose the lengths of lists, so of vectors. */
async function read<Message>(answer: Promise<{ data?: unknown }>): Promise<Message> {
  try {
    return (await answer).data as Message;
  } catch (error) {
    if (error instanceof SyntaxError) throw unreadable(200);
    throw error;
  }
}

/** Parameters of a call that creates something once, however often it is sent. */
const once = (key: string) => ({ header: { "idempotency-key": key } });

const id = encodeURIComponent;
const withQuery = (address: string, query: Query): string => {
  const search = searchOf(query);
  return search ? `${address}?${search}` : address;
};

type Described<Path extends keyof paths> = paths[Path] extends { get: { parameters: { query?: infer Of } } }
  ? NonNullable<Of>
  : never;
/** A query in which null leaves a parameter open. */
type QueryOf<Path extends keyof paths> = {
  [Name in keyof Described<Path>]?: Described<Path>[Name] | null | undefined;
};
export type JobQuery = QueryOf<"/v1/jobs">;
export type RobotQuery = QueryOf<"/v1/robots">;
export type SetQuery = QueryOf<"/v1/measurement-sets">;

/** A query as the API describes it: `searchOf` leaves out what is null. */
const described = <Path extends keyof paths>(query: QueryOf<Path>) => query as Described<Path>;

/** Kinds of work, as the API names them. */
export type Collection = "runs" | "comparisons" | "geometries" | "gearboxes" | "plans" | "maps" | "corrections";

interface Messages {
  runs: of.Run;
  comparisons: of.Comparison;
  geometries: of.Geometry;
  gearboxes: of.Gearbox;
  plans: of.Plan;
  maps: of.Map;
  corrections: of.CorrectionJob;
}

/** Tables of jobs that the page draws. */
export type JobTable = "map" | "rows";

/** A listed job: of runs with what a run always has. */
export type Summary<Of extends Collection> = Of extends "runs" ? of.RunSummary : of.JobSummary;

const KINDS = {
  runs: "run",
  comparisons: "comparison",
  geometries: "geometry",
  gearboxes: "gearbox",
  plans: "plan",
  maps: "map",
  corrections: "correction",
} as const satisfies Record<Collection, of.JobSummary["kind"]>;

const jobs = {
  delete: (job: string) => changeJob(job, { deleted: true }),
  restore: (job: string) => changeJob(job, { deleted: false }),
  cancel: (job: string) => changeJob(job, { cancelled: true }),
  /** The address of a file of a job. */
  file: (job: string, name: string) => `/v1/jobs/${id(job)}/files/${name}`,
};

const changeJob = (job_id: string, body: of.JobChange) =>
  read<unknown>(client.PATCH("/v1/jobs/{job_id}", { params: { path: { job_id } }, body }));

/** List and get jobs of a kind. */
const kind = <Of extends Collection>(collection: Of) => ({
  list: (query: JobQuery = {}, signal?: AbortSignal) =>
    read<of.Page<Summary<Of>>>(
      client.GET("/v1/jobs", {
        params: { query: described<"/v1/jobs">({ kind: KINDS[collection], ...query }) },
        signal: signal ?? null,
      }),
    ),
  one: async (job_id: string, signal?: AbortSignal) => {
    const job = await read<Messages[Collection]>(
      client.GET("/v1/jobs/{job_id}", { params: { path: { job_id } }, signal: signal ?? null }),
    );
    if (job.kind === KINDS[collection]) return job as Messages[Of];
    throw new ApiError(localProblem(text.errors.otherKind, 404));
  },
});

/** A post waits for the end of its job for a second. */
const posted = (key: string) => ({ params: { query: { wait: 1 }, ...once(key) } });

/** Add a job of a kind that is posted as JSON; fields that were filled in are checked by the service. */
const add =
  <Of extends Exclude<Collection, "corrections">>(collection: Of) =>
  (body: unknown, key: string) =>
    read<Messages[Of]>(client.POST(`/v1/${collection}` as "/v1/runs", { ...posted(key), body: body as never }));

/** Add a job of a kind that is posted as files with what is stated of them. */
const addForm =
  <Of extends "corrections">(collection: Of) =>
  (files: File[], stated: unknown, key: string) =>
    read<Messages[Of]>(
      client.POST(`/v1/${collection}` as "/v1/corrections", { ...posted(key), body: form(files, stated) as never }),
    );

const changeRobot = (robot_id: string, body: of.RobotChange) =>
  read<of.Robot>(client.PATCH("/v1/robots/{robot_id}", { params: { path: { robot_id } }, body }));
const changeSet = (set_id: string, body: of.SetChange) =>
  read<of.MeasurementSetSummary>(client.PATCH("/v1/measurement-sets/{set_id}", { params: { path: { set_id } }, body }));
const setPath = (set_id: string) => ({ params: { path: { set_id } } });

const sets = {
  list: (query: SetQuery = {}, signal?: AbortSignal) =>
    read<of.Page<of.MeasurementSetSummary>>(
      client.GET("/v1/measurement-sets", {
        params: { query: described<"/v1/measurement-sets">(query) },
        signal: signal ?? null,
      }),
    ),
  one: (set: string, signal?: AbortSignal) =>
    read<of.MeasurementSet>(client.GET("/v1/measurement-sets/{set_id}", { ...setPath(set), signal: signal ?? null })),
  add: (body: unknown, key: string) =>
    read<of.MeasurementSet>(client.POST("/v1/measurement-sets", { params: once(key), body: body as never })),
  change: changeSet,
  delete: (set: string) => changeSet(set, { deleted: true }),
  restore: (set: string) => changeSet(set, { deleted: false }),
};

const bridgeAt = (bridge: string): string => `/v1/bridges/${id(bridge)}`;

export const api = {
  session: () => read<of.Session>(client.GET(SESSION)),
  signIn: (secret: { key: string } | { link: string }) =>
    read<of.Session>(client.POST(SESSION, { body: secret as never })),
  signOut: () => read<undefined>(client.DELETE(SESSION)),
  health: (signal?: AbortSignal) => read<of.Health>(client.GET("/health", { signal: signal ?? null })),
  /** How the service describes its requests. */
  schemas: async (): Promise<Schemas> => {
    const document = read<{ components: { schemas: Schemas } }>(client.GET("/openapi.json" as "/v1/catalogue"));
    return (await document).components.schemas;
  },
  catalogue: () => read<of.Catalogue>(client.GET("/v1/catalogue")),
  kinematics: (source: of.RobotSource, joints: number[][], signal?: AbortSignal) =>
    read<of.Posture[]>(client.POST("/v1/kinematics", { body: { ...source, joints } as never, signal: signal ?? null })),
  /** Tables of files with the roles of their columns, the next question, and the readings; nothing is stored. */
  importFiles: (files: File[], stated: Partial<of.ImportRequest> = {}, signal?: AbortSignal) =>
    read<of.ImportAnswer>(client.POST("/v1/imports", { body: form(files, stated) as never, signal: signal ?? null })),

  robots: {
    list: (query: RobotQuery = {}, signal?: AbortSignal) =>
      read<of.Page<of.RobotSummary>>(
        client.GET("/v1/robots", { params: { query: described<"/v1/robots">(query) }, signal: signal ?? null }),
      ),
    one: (robot_id: string, signal?: AbortSignal) =>
      read<of.Robot>(client.GET("/v1/robots/{robot_id}", { params: { path: { robot_id } }, signal: signal ?? null })),
    add: (body: unknown, key: string) =>
      read<of.Robot>(client.POST("/v1/robots", { params: once(key), body: body as never })),
    change: changeRobot,
    delete: (robot: string) => changeRobot(robot, { deleted: true }),
    restore: (robot: string) => changeRobot(robot, { deleted: false }),
    trend: (robot_id: string, query: Query, signal?: AbortSignal) =>
      read<of.Trend>(
        client.GET("/v1/robots/{robot_id}/trend", { params: { path: { robot_id }, query }, signal: signal ?? null }),
      ),
  },
  sets,
  openSets: {
    ...sets,
    one: sets.one as (set: string, signal?: AbortSignal) => Promise<of.OpenSet>,
    add: sets.add as (body: unknown, key: string) => Promise<of.OpenSet>,
    observe: (set: string, body: of.Observation) =>
      read<of.LiveState>(client.POST("/v1/measurement-sets/{set_id}/observations", { ...setPath(set), body })),
    state: (set: string, signal?: AbortSignal) =>
      read<of.LiveState>(client.GET("/v1/measurement-sets/{set_id}/next", { ...setPath(set), signal: signal ?? null })),
    close: (set: string) => read<of.LiveState>(client.POST("/v1/measurement-sets/{set_id}/close", setPath(set))),
    followed: (set: string) => `/v1/measurement-sets/${id(set)}/next?follow=true`,
    /** The address of a drawing: the page's own address as a QR code, for a tablet. */
    code: (set: string, page: string) => withQuery(`/v1/measurement-sets/${id(set)}/code.svg`, { page }),
  },

  /** Bridges from trackers, which the description of the API leaves out: paths and messages are stated here. */
  bridges: {
    open: (set: string) =>
      read<of.Paired>(
        client.POST(`/v1/measurement-sets/${id(set)}/bridge` as "/v1/measurement-sets/{set_id}/close", setPath(set)),
      ),
    show: (bridge: string, stand: of.BridgeStand) =>
      read<undefined>(client.PUT(`${bridgeAt(bridge)}/stand` as never, { body: stand } as never)),
    end: (bridge: string) => read<undefined>(client.DELETE(bridgeAt(bridge) as never, {} as never)),
    /** Fails with 404 when the bridge has ended. */
    check: (bridge: string) => read<undefined>(client.HEAD(bridgeAt(bridge) as never, {} as never)),
    followed: (bridge: string) => bridgeAt(bridge),
  },

  jobs,
  runs: { ...kind("runs"), add: add("runs") },
  comparisons: { ...kind("comparisons"), add: add("comparisons") },
  geometries: kind("geometries"),
  gearboxes: { ...kind("gearboxes"), add: add("gearboxes") },
  plans: { ...kind("plans"), add: add("plans") },
  maps: { ...kind("maps"), add: add("maps") },
  corrections: { ...kind("corrections"), add: addForm("corrections") },
  predict: (body: unknown) => read<of.DeflectionResult>(client.POST("/v1/deflections", { body: body as never })),
  apply: (run_id: string, body: of.AdvisedAction) =>
    read<of.Run>(client.POST("/v1/runs/{run_id}/apply", { params: { path: { run_id }, query: { wait: 1 } }, body })),
  tables: (job: string, view: Query, signal?: AbortSignal) => file<of.ShownTables>(job, "tables.json", view, signal),
  /** A table of a job, column by column. */
  table: (job: string, name: JobTable, signal?: AbortSignal) => file<Columns>(job, `${name}.json`, {}, signal),
  correctedFile: (correction: string, file: string) => withQuery(jobs.file(correction, "program"), { file }),
};

/** The content of a file of a job that is JSON. */
const file = <Content>(job_id: string, name: string, query: Query, signal?: AbortSignal) =>
  read<Content>(
    client.GET("/v1/jobs/{job_id}/files/{name}", {
      params: { path: { job_id, name }, query: query as never },
      signal: signal ?? null,
      parseAs: "json",
    }),
  );

/** Files, and what is stated of them. */
function form(files: File[], stated: unknown): FormData {
  const body = new FormData();
  for (const file of files) body.append("files", file);
  body.append("options", jsonOf(stated));
  return body;
}
