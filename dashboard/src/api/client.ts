/** The API over fetch: JSON in, JSON out, and every failure as problem details with a remedy. */
import { text } from "../i18n";
import type {
  Authorisation,
  AuthorisationList,
  Catalogue,
  Comparison,
  ComparisonSummary,
  Fleet,
  Geometry,
  GeometrySummary,
  Health,
  ImportAnswer,
  ImportOptions,
  Kinematics,
  Map as WorkMap,
  MapSummary,
  ProgramSummary,
  MeasurementSet,
  MeasurementSetSummary,
  Page,
  Pair,
  PairSummary,
  Plan,
  PlanSummary,
  Problem,
  Program,
  Robot,
  RobotChange,
  RobotRequest,
  RobotSource,
  RobotSummary,
  Run,
  RunSummary,
  Session,
  SetChange,
  Trend,
} from "./types";

/** A refusal, or an answer that did not come. */
export class ApiError extends Error {
  constructor(readonly problem: Problem) {
    super(problem.detail);
  }
}

interface Call {
  body?: unknown;
  key?: string;
  signal?: AbortSignal;
}

const refusals = new Set<() => void>();

/** Hear of answers that a key is needed. Answers with how to stop. */
export function onRefused(hear: () => void): () => void {
  refusals.add(hear);
  return () => void refusals.delete(hear);
}

/** What was thrown, as problem details. */
export function problemOf(error: unknown): Problem {
  if (error instanceof ApiError) return error.problem;
  return {
    type: "about:blank",
    title: text.errors.unexpected,
    status: 0,
    detail: String(error),
    where: null,
    remedy: null,
    request_id: null,
    errors: [],
  };
}

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
      ...(body === undefined ? {} : { body: form ? body : JSON.stringify(body) }),
      ...(signal === undefined ? {} : { signal }),
    });
  } catch (error) {
    if (signal?.aborted) throw error;
    throw new ApiError(unreachable());
  }
  if (response.ok) return response;
  const answer: unknown = await response.json().catch(() => null);
  if (response.status === 401 && path !== SESSION) refusals.forEach((hear) => hear());
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

const textOf = async (path: string): Promise<string> => (await answerOf("GET", path)).text();

function isProblem(answer: unknown): answer is Problem {
  return typeof answer === "object" && answer !== null && "detail" in answer && "title" in answer;
}

function unreachable(): Problem {
  const { unreachable: words } = text.errors;
  return {
    type: "about:blank",
    title: words.title,
    status: 0,
    detail: words.detail,
    where: null,
    remedy: words.remedy,
    request_id: null,
    errors: [],
  };
}

function unreadable(status: number): Problem {
  const { unreadable: words } = text.errors;
  return {
    type: "about:blank",
    title: words.title,
    status,
    detail: words.detail(status),
    where: null,
    remedy: words.remedy,
    request_id: null,
    errors: [],
  };
}

function query(values: Record<string, string | number | null | undefined>): string {
  const pairs = Object.entries(values).filter(([, value]) => value !== null && value !== undefined && value !== "");
  const search = new URLSearchParams(pairs.map(([name, value]) => [name, String(value)])).toString();
  return search && `?${search}`;
}

type Filters = Record<string, string | number | null | undefined>;

const id = encodeURIComponent;

const SESSION = "/v1/session";

/** Every address of the API that the page uses. */
export const api = {
  session: () => call<Session>("GET", SESSION),
  signIn: (secret: { key: string } | { link: string }) => call<Session>("POST", SESSION, { body: secret }),
  signOut: () => call<undefined>("DELETE", SESSION),
  health: (signal?: AbortSignal) => call<Health>("GET", "/health", options(signal)),

  robots: (filters: Filters = {}, signal?: AbortSignal) =>
    call<Page<RobotSummary>>("GET", `/v1/robots${query(filters)}`, options(signal)),
  robot: (robot: string, signal?: AbortSignal) => call<Robot>("GET", `/v1/robots/${id(robot)}`, options(signal)),
  addRobot: (document: RobotRequest, key: string) => call<Robot>("POST", "/v1/robots", { body: document, key }),
  changeRobot: (robot: string, change: RobotChange) =>
    call<Robot>("PATCH", `/v1/robots/${id(robot)}`, { body: change }),
  catalogue: () => call<Catalogue>("GET", "/v1/catalogue"),
  deleteRobot: (robot: string) => call<undefined>("DELETE", `/v1/robots/${id(robot)}`),
  restoreRobot: (robot: string) => call<Robot>("POST", `/v1/robots/${id(robot)}/restore`),
  trend: (robot: string, filters: Filters, signal?: AbortSignal) =>
    call<Trend>("GET", `/v1/robots/${id(robot)}/trend${query(filters)}`, options(signal)),
  addBaseline: (robot: string, body: { run_id: string; reason: string; campaigns: number }) =>
    call<unknown>("POST", `/v1/robots/${id(robot)}/trend/baselines`, { body }),
  acknowledge: (robot: string, body: { run_id: string; joint: string; note: string }) =>
    call<unknown>("POST", `/v1/robots/${id(robot)}/trend/acknowledgements`, { body }),
  fleet: (signal?: AbortSignal) => call<Fleet>("GET", "/v1/fleet", options(signal)),
  kinematics: (source: RobotSource, joints: number[][], signal?: AbortSignal) =>
    call<Kinematics>("POST", "/v1/kinematics", { body: { ...source, joints }, ...options(signal) }),

  sets: (filters: Filters = {}, signal?: AbortSignal) =>
    call<Page<MeasurementSetSummary>>("GET", `/v1/measurement-sets${query(filters)}`, options(signal)),
  set: (set: string, signal?: AbortSignal) =>
    call<MeasurementSet>("GET", `/v1/measurement-sets/${id(set)}`, options(signal)),
  deleteSet: (set: string) => call<undefined>("DELETE", `/v1/measurement-sets/${id(set)}`),
  restoreSet: (set: string) => call<MeasurementSet>("POST", `/v1/measurement-sets/${id(set)}/restore`),
  changeSet: (set: string, change: SetChange) =>
    call<MeasurementSetSummary>("PATCH", `/v1/measurement-sets/${id(set)}`, { body: change }),
  /** What files of readings were understood as; nothing is stored. */
  importFiles: (files: File[], stated: ImportOptions = {}, signal?: AbortSignal) =>
    call<ImportAnswer>("POST", "/v1/imports", { body: form(files, stated), ...options(signal) }),
  addSet: (document: unknown, key: string) =>
    call<MeasurementSet>("POST", "/v1/measurement-sets", { body: document, key }),

  runs: (filters: Filters = {}, signal?: AbortSignal) =>
    call<Page<RunSummary>>("GET", `/v1/runs${query(filters)}`, options(signal)),
  run: (run: string, signal?: AbortSignal) => call<Run>("GET", `/v1/runs/${id(run)}`, options(signal)),
  addRun: (request: unknown, key: string) => call<Run>("POST", "/v1/runs?wait=1", { body: request, key }),
  cancelRun: (run: string) => call<Run>("POST", `/v1/runs/${id(run)}/cancel`),
  deleteRun: (run: string) => call<undefined>("DELETE", `/v1/runs/${id(run)}`),
  restoreRun: (run: string) => call<Run>("POST", `/v1/runs/${id(run)}/restore`),

  comparisons: (filters: Filters = {}, signal?: AbortSignal) =>
    call<Page<ComparisonSummary>>("GET", `/v1/comparisons${query(filters)}`, options(signal)),
  comparison: (comparison: string, signal?: AbortSignal) =>
    call<Comparison>("GET", `/v1/comparisons/${id(comparison)}`, options(signal)),
  addComparison: (request: unknown, key: string) =>
    call<Comparison>("POST", "/v1/comparisons?wait=1", { body: request, key }),
  cancelComparison: (comparison: string) => call<Comparison>("POST", `/v1/comparisons/${id(comparison)}/cancel`),

  deleteComparison: (comparison: string) => call<undefined>("DELETE", `/v1/comparisons/${id(comparison)}`),
  restoreComparison: (comparison: string) => call<Comparison>("POST", `/v1/comparisons/${id(comparison)}/restore`),

  runReport: (run: string, format: "pdf" | "html") => `/v1/runs/${id(run)}/report.${format}`,
  authorisations: (run: string, signal?: AbortSignal) =>
    call<AuthorisationList>("GET", `/v1/runs/${id(run)}/authorisations`, options(signal)),
  authorise: (run: string, note: string) =>
    call<Authorisation>("POST", `/v1/runs/${id(run)}/authorisations`, { body: { note: note || null } }),
  runModel: (run: string, format: "csv" | "xlsx" | "urdf" | "sdf" | "mjcf") => `/v1/runs/${id(run)}/model.${format}`,

  pairs: (filters: Filters = {}, signal?: AbortSignal) =>
    call<Page<PairSummary>>("GET", `/v1/pairs${query(filters)}`, options(signal)),
  pair: (pair: string, signal?: AbortSignal) => call<Pair>("GET", `/v1/pairs/${id(pair)}`, options(signal)),
  deletePair: (pair: string) => call<undefined>("DELETE", `/v1/pairs/${id(pair)}`),
  restorePair: (pair: string) => call<Pair>("POST", `/v1/pairs/${id(pair)}/restore`),
  addPair: (request: unknown, key: string) => call<Pair>("POST", "/v1/pairs", { body: request, key }),

  geometries: (filters: Filters = {}, signal?: AbortSignal) =>
    call<Page<GeometrySummary>>("GET", `/v1/geometries${query(filters)}`, options(signal)),
  geometry: (geometry: string, signal?: AbortSignal) =>
    call<Geometry>("GET", `/v1/geometries/${id(geometry)}`, options(signal)),
  addGeometry: (request: unknown, key: string) => call<Geometry>("POST", "/v1/geometries", { body: request, key }),
  deleteGeometry: (geometry: string) => call<undefined>("DELETE", `/v1/geometries/${id(geometry)}`),
  restoreGeometry: (geometry: string) => call<Geometry>("POST", `/v1/geometries/${id(geometry)}/restore`),

  plans: (filters: Filters = {}, signal?: AbortSignal) =>
    call<Page<PlanSummary>>("GET", `/v1/plans${query(filters)}`, options(signal)),
  plan: (plan: string, signal?: AbortSignal) => call<Plan>("GET", `/v1/plans/${id(plan)}`, options(signal)),
  addPlan: (request: unknown, key: string) => call<Plan>("POST", "/v1/plans", { body: request, key }),
  deletePlan: (plan: string) => call<undefined>("DELETE", `/v1/plans/${id(plan)}`),
  restorePlan: (plan: string) => call<Plan>("POST", `/v1/plans/${id(plan)}/restore`),
  program: (program: string, signal?: AbortSignal) =>
    call<Program>("GET", `/v1/programs/${id(program)}`, options(signal)),
  programTable: (program: string) => `/v1/programs/${id(program)}/points.csv`,
  programPoints: (program: string) => textOf(api.programTable(program)),
  programFile: (program: string, file: string) => `/v1/programs/${id(program)}/program${query({ file })}`,
  programs: (filters: Filters = {}, signal?: AbortSignal) =>
    call<Page<ProgramSummary>>("GET", `/v1/programs${query(filters)}`, options(signal)),
  addProgram: (files: File[], stated: unknown, key: string) =>
    call<Program>("POST", "/v1/programs?wait=1", { body: form(files, stated), key }),
  cancelProgram: (program: string) => call<Program>("POST", `/v1/programs/${id(program)}/cancel`),
  deleteProgram: (program: string) => call<undefined>("DELETE", `/v1/programs/${id(program)}`),
  restoreProgram: (program: string) => call<Program>("POST", `/v1/programs/${id(program)}/restore`),

  maps: (filters: Filters = {}, signal?: AbortSignal) =>
    call<Page<MapSummary>>("GET", `/v1/maps${query(filters)}`, options(signal)),
  map: (map: string, signal?: AbortSignal) => call<WorkMap>("GET", `/v1/maps/${id(map)}`, options(signal)),
  mapFile: (map: string, extension: "csv" | "npz") => `/v1/maps/${id(map)}/map.${extension}`,
  mapTable: (map: string) => textOf(api.mapFile(map, "csv")),
  addMap: (request: unknown, key: string) => call<WorkMap>("POST", "/v1/maps?wait=1", { body: request, key }),
  cancelMap: (map: string) => call<WorkMap>("POST", `/v1/maps/${id(map)}/cancel`),
  deleteMap: (map: string) => call<undefined>("DELETE", `/v1/maps/${id(map)}`),
  restoreMap: (map: string) => call<WorkMap>("POST", `/v1/maps/${id(map)}/restore`),
};

/** Files, and what is stated of them. */
function form(files: File[], stated: unknown): FormData {
  const body = new FormData();
  for (const file of files) body.append("files", file);
  body.append("options", JSON.stringify(stated));
  return body;
}

function options(signal: AbortSignal | undefined): Call {
  return signal === undefined ? {} : { signal };
}

/** All items of a listing, newest first, up to a limit. */
export async function every<Item>(
  list: (filters: Filters, signal?: AbortSignal) => Promise<Page<Item>>,
  filters: Filters = {},
  limit = 500,
  signal?: AbortSignal,
): Promise<Item[]> {
  const items: Item[] = [];
  let cursor: string | null = null;
  do {
    const page: Page<Item> = await list({ ...filters, limit: 100, cursor }, signal);
    items.push(...page.items);
    cursor = page.next;
  } while (cursor !== null && items.length < limit);
  return items;
}
