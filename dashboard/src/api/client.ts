/** The API over fetch: JSON in, JSON out, every failure as problem details with a remedy; server-sent events of jobs. */
import { text } from "../i18n";
import { listen, tell } from "../lib/events";
import { type Columns, jsonOf } from "../lib/json";
import type { Schemas } from "../lib/schema";
import type * as of from "./types";
import type { Progress, RunState } from "./types";

/** A refusal, or an answer that did not come. */
export class ApiError extends Error {
  constructor(readonly problem: of.Problem) {
    super(problem.detail);
  }
}

interface Call {
  body?: unknown;
  key?: string;
  signal?: AbortSignal | undefined;
}

/** What was thrown, as problem details. */
export const problemOf = (error: unknown): of.Problem =>
  error instanceof ApiError ? error.problem : ours({ title: text.errors.unexpected, detail: String(error) });

/** A problem of which the service says nothing. */
const ours = (said: { title: string; detail: string; remedy?: string }, status = 0): of.Problem => ({
  type: "about:blank",
  where: null,
  remedy: null,
  request_id: null,
  errors: [],
  status,
  ...said,
});

async function answerOf(method: string, path: string, { body, key, signal }: Call = {}): Promise<Response> {
  const headers: Record<string, string> = { Accept: "application/json" };
  const form = body instanceof FormData;
  if (body !== undefined && !form) headers["Content-Type"] = "application/json";
  if (key !== undefined) headers["Idempotency-Key"] = key;
  let response: Response;
  try {
    response = await fetch(path, {
      method,
      headers,
      ...(body === undefined ? {} : { body: form ? body : jsonOf(body) }),
      ...(signal === undefined ? {} : { signal }),
    });
  } catch (error) {
    if (signal?.aborted) throw error;
    throw new ApiError(ours(text.errors.unreachable));
  }
  if (response.ok) return response;
  const answer: unknown = await response.json().catch(() => null);
  if (response.status === 401 && path !== SESSION) tell("refused");
  throw new ApiError(isProblem(answer) ? answer : unreadable(response.status));
}

async function call<Answer>(method: string, path: string, asked: Call = {}): Promise<Answer> {
  const response = await answerOf(method, path, asked);
  if (response.status === 204) return undefined as Answer;
  try {
    return (await response.json()) as Answer;
  } catch {
    throw new ApiError(unreadable(response.status));
  }
}

function isProblem(answer: unknown): answer is of.Problem {
  return typeof answer === "object" && answer !== null && "detail" in answer && "title" in answer;
}

function unreadable(status: number): of.Problem {
  const { detail, ...words } = text.errors.unreadable;
  return ours({ ...words, detail: detail(status) }, status);
}

function query(values: Record<string, string | number | null | undefined>): string {
  const pairs = Object.entries(values).filter(([, value]) => value !== null && value !== undefined && value !== "");
  const search = new URLSearchParams(pairs.map(([name, value]) => [name, String(value)])).toString();
  return search && `?${search}`;
}

type Filters = Record<string, string | number | null | undefined>;

const id = encodeURIComponent;

const SESSION = "/v1/session";

/** The addresses that all collections share; `asked`: what is always asked of a listing. */
function collection<Item, Summary, Change = never>(name: string, asked: Filters = {}) {
  const at = (item: string) => `/v1/${name}/${id(item)}`;
  return {
    list: (filters: Filters = {}, signal?: AbortSignal) =>
      call<of.Page<Summary>>("GET", `/v1/${name}${query({ ...asked, ...filters })}`, { signal }),
    one: (item: string, signal?: AbortSignal) => call<Item>("GET", at(item), { signal }),
    add: (body: unknown, key: string) => call<Item>("POST", `/v1/${name}`, { body, key }),
    change: (item: string, body: Change) => call<unknown>("PATCH", at(item), { body }),
    delete: (item: string) => call<unknown>("PATCH", at(item), { body: { deleted: true } }),
    restore: (item: string) => call<unknown>("PATCH", at(item), { body: { deleted: false } }),
    /** The address of what belongs to an item. */
    below: (item: string, name: string) => `${at(item)}/${name}`,
  };
}

/** The addresses that jobs of all kinds share. */
const jobs = {
  ...collection<unknown, unknown>("jobs"),
  cancel: (job: string) => call<unknown>("PATCH", `/v1/jobs/${id(job)}`, { body: { cancelled: true } }),
  /** The address of a file of a job. */
  file: (job: string, name: string) => `/v1/jobs/${id(job)}/files/${name}`,
};

/** Jobs of a kind, which are posted at an address of their own; the answer to a post is waited for for a second. */
const kind = <Job extends { kind: of.JobSummary["kind"] }, Summary = of.JobSummary>(
  name: Job["kind"],
  posted: Collection,
) => ({
  ...collection<Job, Summary>("jobs", { kind: name }),
  one: async (job: string, signal?: AbortSignal) => {
    const found = await call<Job | { kind: null }>("GET", `/v1/jobs/${id(job)}`, { signal });
    if (found.kind === name) return found as Job;
    throw new ApiError(ours(text.errors.otherKind, 404));
  },
  add: (body: unknown, key: string) => call<Job>("POST", `/v1/${posted}?wait=1`, { body, key }),
});

const runs = kind<of.Run, of.RunSummary>("run", "runs");
const maps = kind<of.Map>("map", "maps");
const programs = kind<of.Program>("program", "programs");
const openSets = collection<of.OpenSet, of.MeasurementSetSummary, of.SetChange>("measurement-sets");
const robots = collection<of.Robot, of.RobotSummary, of.RobotChange>("robots");

/** Every address of the API that the page uses. */
export const api = {
  session: () => call<of.Session>("GET", SESSION),
  signIn: (secret: { key: string } | { link: string }) => call<of.Session>("POST", SESSION, { body: secret }),
  signOut: () => call<undefined>("DELETE", SESSION),
  health: (signal?: AbortSignal) => call<of.Health>("GET", "/health", { signal }),
  /** How the service describes its requests. */
  schemas: () =>
    call<{ components: { schemas: Schemas } }>("GET", "/openapi.json").then(({ components }) => components.schemas),
  catalogue: () => call<of.Catalogue>("GET", "/v1/catalogue"),
  kinematics: (source: of.RobotSource, joints: number[][], signal?: AbortSignal) =>
    call<of.Posture[]>("POST", "/v1/kinematics", { body: { ...source, joints }, signal }),
  /** What files of readings were understood as; nothing is stored. */
  importFiles: (files: File[], stated: of.ImportOptions = {}, signal?: AbortSignal) =>
    call<of.ImportAnswer>("POST", "/v1/imports", { body: form(files, stated), signal }),

  robots,
  trend: (robot: string, filters: Filters, signal?: AbortSignal) =>
    call<of.Trend>("GET", `${robots.below(robot, "trend")}${query(filters)}`, { signal }),
  sets: collection<of.MeasurementSet, of.MeasurementSetSummary, of.SetChange>("measurement-sets"),
  openSets: {
    ...openSets,
    observe: (set: string, body: of.Observation) =>
      call<of.LiveState>("POST", openSets.below(set, "observations"), { body }),
    state: (set: string, signal?: AbortSignal) => call<of.LiveState>("GET", openSets.below(set, "next"), { signal }),
    close: (set: string) => call<of.LiveState>("POST", openSets.below(set, "close")),
    followed: (set: string) => `${openSets.below(set, "next")}?follow=true`,
    /** The address of a drawing: the page's own address as a QR code, for a tablet. */
    code: (set: string, page: string) => openSets.below(set, `code.svg${query({ page })}`),
  },

  jobs,
  runs,
  predict: (body: unknown) => call<of.DeflectionResult>("POST", "/v1/deflections", { body }),
  comparisons: kind<of.Comparison>("comparison", "comparisons"),
  fleets: kind<of.Fleet>("fleet", "fleets"),
  geometries: kind<of.Geometry>("geometry", "geometries"),
  plans: kind<of.Plan>("plan", "plans"),
  maps,
  mapTable: (map: string) => call<Columns>("GET", jobs.file(map, "map.json")),
  programs,
  tables: (job: string, view: Filters) =>
    call<{ tables: of.ShownTable[]; lines: string[]; evidence: string[] }>(
      "GET",
      `${jobs.file(job, "tables.json")}${query(view)}`,
    ),
  apply: (run: string, action: of.Action) => call<of.Run>("POST", `/v1/runs/${run}/apply?wait=1`, { body: action }),
  addProgram: (files: File[], stated: unknown, key: string) => programs.add(form(files, stated), key),
  programPoints: (program: string) => call<Columns>("GET", jobs.file(program, "points.json")),
  programFile: (program: string, file: string) => jobs.file(program, `program${query({ file })}`),
};

/** Files, and what is stated of them. */
function form(files: File[], stated: unknown): FormData {
  const body = new FormData();
  for (const file of files) body.append("files", file);
  body.append("options", jsonOf(stated));
  return body;
}

/** All items of a listing, newest first, up to a limit. */
export async function every<Item>(
  list: (filters: Filters, signal?: AbortSignal) => Promise<of.Page<Item>>,
  filters: Filters = {},
  limit = 500,
  signal?: AbortSignal,
): Promise<Item[]> {
  const items: Item[] = [];
  let cursor: string | null = null;
  do {
    const page: of.Page<Item> = await list({ ...filters, limit: 100, cursor }, signal);
    items.push(...page.items);
    cursor = page.next;
  } while (cursor !== null && items.length < limit);
  return items;
}

export interface Standing {
  id: string;
  state: RunState;
  progress: Progress | null;
}

/** Kinds of work, as the API names them. */
export type Collection = "runs" | "comparisons" | "fleets" | "geometries" | "plans" | "maps" | "programs";

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
  listen(source, { open: () => away?.(false), error: () => away?.(true), progress: hear(false), end: hear(true) });
  return () => source.close();
}

export const goesOn = (state: RunState): boolean => state === "queued" || state === "running";
