/** Runs that a comparison takes, made first: by each method and constraint, or without constraints. */
import { api, ApiError } from "../api/client";
import { goesOn } from "../api/events";
import type { Comparison, Run } from "../api/types";
import { contentKey, freshKey } from "../lib/hash";

/** The paper's methods, and the complete pose with weights of covariance. */
const METHODS = [
  { method: "complete_pose", weighting: "characteristic_length" },
  { method: "complete_pose", weighting: "covariance" },
  { method: "partial_pose", weighting: "covariance" },
  { method: "decoupled_partial_pose", weighting: "covariance" },
] as const;
const PARTIAL = METHODS[2];
const UNCONSTRAINED = { positive: false, stiffness_bounds: {}, stiffness_order: [] };
const LOOK_AGAIN = 300;

interface Draws {
  size: number;
  repetitions: number;
  seed: number;
}

type Options = Partial<Run["request"]> & { measurement_set_id: string };

/** A run once it has ended; the same options give the same run. */
async function identified(options: Options): Promise<Run> {
  const known = await api.runs.add(options, contentKey("run", options));
  // one that was deleted meanwhile is made again
  let run = await api.runs.one(known.id).catch(() => api.runs.add(options, freshKey("run")));
  while (goesOn(run.state)) {
    await new Promise((ready) => setTimeout(ready, LOOK_AGAIN));
    run = await api.runs.one(run.id);
  }
  return run;
}

const optionsOf = (set: string, method: (typeof METHODS)[number], positive: boolean): Options => ({
  measurement_set_id: set,
  elasticity: "joints",
  positive,
  ...method,
});

/** The runs of a set by all methods, unconstrained and constrained; none by methods that it cannot support. */
async function byMethods(set: string, resampling: Draws | null): Promise<Run[]> {
  const asked = METHODS.flatMap((method) =>
    [false, true].map((positive) => ({
      ...optionsOf(set, method, positive),
      ...(resampling && { resampling: { ...resampling, replacement: false } }),
    })),
  );
  const made = await Promise.all(
    asked.map((options) =>
      identified(options).catch((error: unknown) => {
        if (error instanceof ApiError && error.problem.status === 422) return null;
        throw error;
      }),
    ),
  );
  return made.filter((run) => run !== null);
}

/** A run of joints alone with the options of a run, and the same without constraints where one holds a joint. */
async function comparable(run: Run): Promise<Run[]> {
  const { variant_of: _, ...options } = run.request;
  const joints = { ...options, elasticity: "joints" as const, resampling: null };
  const plain = (run.result?.choice?.elasticity ?? "joints") === "joints" ? run : await identified(joints);
  const held = plain.result?.joints.some((joint) => joint.status === "at_bound") ?? false;
  return held ? [plain, await identified({ ...joints, ...UNCONSTRAINED })] : [plain];
}

const compared = (runs: Run[], ordered = false): Promise<Comparison> =>
  api.comparisons.add({ run_ids: [...new Set(runs.map((run) => run.id))], ordered }, freshKey("comparison"));

/** Compare all methods on a set. */
export async function compareMethods(set: string, resampling: Draws | null): Promise<Comparison> {
  return compared(await byMethods(set, resampling));
}

/** A side of a comparison: a run, or a set, which is identified. */
export type SideOf = { run: Run } | { set: string };

/** Compare two sides, on request by all methods. */
export async function compareSides(sides: SideOf[], ordered: boolean, methods: boolean): Promise<Comparison> {
  const runs = await Promise.all(
    sides.map(async (side) => {
      const own = "run" in side ? side.run : await identified(optionsOf(side.set, PARTIAL, true));
      const leading = await comparable(own);
      return methods ? [...leading, ...(await byMethods(own.request.measurement_set_id, null))] : leading;
    }),
  );
  return compared(runs.flat(), ordered);
}
