/** What the parts of a run's page share, and what the pages of maps and programs need of their run. */
import { api } from "../api/client";
import type { Elasticity, MeasurementSet, Robot, Run } from "../api/types";
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

/** What bends in the numbers; until there are some, what was asked for. */
export const elasticityOf = (run: Run): Elasticity => run.result?.choice?.elasticity ?? run.request.elasticity;

/** Whether more than the joints bend, each by itself. */
export const isElastic = (run: Run): boolean => !["joints", "automatic"].includes(elasticityOf(run));
