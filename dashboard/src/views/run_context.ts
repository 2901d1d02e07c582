/** What the parts of a run's page share, and what the pages of maps and programs need of their run. */
import { queries } from "../api/queries";
import type { Elasticity, MeasurementSet, Posture, Robot, Run, RunRequest, RunResult, RunSummary } from "../api/types";
import { text } from "../i18n";
import { standOf } from "../lib/live";
import { ask, useQuery } from "../state/query";

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

type Asked = Pick<RunSummary, "method" | "positive" | "weighting" | "elasticity"> &
  Partial<Pick<RunRequest, "loss" | "complementary_stiffness" | "leave_out" | "variant_of">>;

/** How a run was made: its method, then what is not usual. */
export const waysOf = ({
  positive,
  weighting,
  elasticity,
  leave_out: left = [],
  variant_of: origin,
  ...asked
}: Asked): string[] => [
  positive ? text.options.constrained : text.options.unconstrained,
  ...(weighting === "covariance" ? [] : [text.weightings[weighting]]),
  ...(elasticity === "joints" || elasticity === "automatic" ? [] : [text.elasticities[elasticity]]),
  ...(asked.loss && asked.loss !== "automatic" ? [text.assessment.loss[asked.loss]] : []),
  ...(asked.complementary_stiffness === "neglected" ? [text.assessment.neglected] : []),
  ...(left.length > 0 ? [text.lists.without(left)] : []),
  ...(origin ? [text.assessment.variant] : []),
];

export const howOf = (run: Asked): string => [text.methods[run.method], ...waysOf(run)].join(", ");
