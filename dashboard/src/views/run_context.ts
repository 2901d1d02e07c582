/** What the parts of a run's page share, and what the pages of maps and programs need of their run. */
import { api } from "../api/client";
import type { MeasurementSet, Robot, Run } from "../api/types";
import { cached } from "../state/cache";
import { storedRobot, storedSet } from "../state/stored";

/** A run with what it is about. */
export interface RunContext {
  run: Run;
  set: MeasurementSet;
  robot: Robot;
}

export async function contextOf(run: Run): Promise<RunContext> {
  const set = await storedSet(run.request.measurement_set_id);
  return { run, set, robot: await storedRobot(set.robot_id) };
}

/** Of a run that has ended, from which something was made. */
export const contextOfEnded = async (run: string): Promise<RunContext> =>
  contextOf(await cached(`run/${run}`, () => api.runs.one(run)));

/** Whether more than the joints may bend, each by itself. */
export const isElastic = (run: Run): boolean => (run.request.elasticity ?? "joints") !== "joints";
