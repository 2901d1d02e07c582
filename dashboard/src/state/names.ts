/** Names of robots and sets by their identifiers, for lists that only have those. */
import { api, every } from "../api/client";
import type { MeasurementSetSummary, RobotSummary } from "../api/types";
import { forget, useCached } from "./cache";
import type { Loading } from "./load";

export interface Names {
  robots: RobotSummary[];
  sets: MeasurementSetSummary[];
  /** What lists leave out; its names still stand on runs. */
  archived: { robots: RobotSummary[]; sets: MeasurementSetSummary[] };
  robot: (id: string) => string;
  set: (id: string) => string;
}

const KEY = "names";

/** All names; an identifier that is not among them stands for itself. */
export function useNames(): Loading<Names> {
  return useCached(KEY, loadNames);
}

/** A robot or a set was added or changed. */
export const namesChanged = (): void => forget(KEY);

async function loadNames(): Promise<Names> {
  const away = { archived: "true" };
  const [robots, sets, oldRobots, oldSets] = await Promise.all([
    every(api.robots.list, {}, 1000),
    every(api.sets.list, {}, 1000),
    every(api.robots.list, away, 1000),
    every(api.sets.list, away, 1000),
  ]);
  const robotNames = new Map([...robots, ...oldRobots].map((robot) => [robot.id, robot.name]));
  const setNames = new Map([...sets, ...oldSets].map((set) => [set.id, set.name]));
  return {
    robots,
    sets,
    archived: { robots: oldRobots, sets: oldSets },
    robot: (id) => robotNames.get(id) ?? id.slice(0, 8),
    set: (id) => setNames.get(id) ?? id.slice(0, 8),
  };
}
