/** What the parts of a run's page share, and what the pages of maps and corrections need of their run. */
import { queries } from "../api/queries";
import type { Elasticity, MeasurementSet, Posture, Robot, Run, RunResult } from "../api/types";
import { standOf } from "../lib/observation";
import { ask, useQuery } from "./query";

/** A run with what it is about. */
export interface RunContext {
  run: Run;
  set: MeasurementSet;
  robot: Robot;
}

/** What each part of its page is given. */
export interface PartProps {
  context: RunContext;
  result: RunResult;
  query: URLSearchParams;
}

export async function contextOf(run: Run): Promise<RunContext> {
  const set = await ask(queries.set(run.request.measurement_set_id));
  return { run, set, robot: await ask(queries.robot(set.robot_id)) };
}

/** Of a run that has ended, from which something was made. */
export const contextOfEnded = async (run: string): Promise<RunContext> => contextOf(await ask(queries.run(run)));

/** What bends in the numbers; until there are some, what was asked for. */
export const elasticityOf = (run: Run): Elasticity => run.result?.choice?.elasticity ?? run.request.elasticity;

/** Whether more than the joints bend, each by itself. */
export const isElastic = (run: Run): boolean => !["joints", "automatic"].includes(elasticityOf(run));

/** Joints of the first observation, or of an arm that was not measured all zero [rad, m]. */
export function firstStand({ set, robot: { joints } }: { set?: MeasurementSet; robot: Robot }): number[] {
  const [first] = set?.observations ?? [];
  return set && first
    ? standOf(
        first,
        set.units,
        joints.map(({ kind }) => kind),
      ).joints
    : joints.map(() => 0);
}

const AT_A_TIME = 500; // the service takes 1000 at most

/** One posture an observation, or null while they are on their way. */
export function usePostures(set: MeasurementSet, robot: Robot): Posture[] | null {
  const options = {
    queryKey: ["postures", set.id],
    queryFn: () => posturesOf(set, robot),
    staleTime: "static",
  } as const;
  return useQuery(options).data ?? null;
}

export async function posturesOf(set: MeasurementSet, robot: Pick<Robot, "joints">): Promise<Posture[]> {
  const kinds = robot.joints.map(({ kind }) => kind);
  const joints = set.observations.map((observation) => standOf(observation, set.units, kinds).joints);
  const postures: Posture[] = [];
  for (let i = 0; i < joints.length; i += AT_A_TIME) {
    postures.push(...(await ask(queries.kinematics({ robot_id: set.robot_id }, joints.slice(i, i + AT_A_TIME)))));
  }
  return postures;
}
