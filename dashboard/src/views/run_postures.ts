/** The postures of all configurations of a set, asked for once. */
import { useMemo } from "preact/hooks";
import { api } from "../api/client";
import type { MeasurementSet, Posture, Robot } from "../api/types";
import { factors } from "../lib/units";
import { useCached } from "../state/cache";
import { valueOf } from "../state/load";

const AT_A_TIME = 500; // the service takes 1000 at most

/** One posture an observation, or null while they are on their way. */
export function usePostures(set: MeasurementSet, robot: Robot): Posture[] | null {
  const loaded = useCached(`postures/${set.id}`, () => ask(set, robot), Number.POSITIVE_INFINITY);
  return useMemo(() => valueOf(loaded), [loaded.state]);
}

async function ask(set: MeasurementSet, robot: Robot): Promise<Posture[]> {
  const { angle } = factors(set.units);
  const joints = set.observations.map((observation) => observation.joints.map((value) => value * angle));
  const postures: Posture[] = [];
  for (let i = 0; i < joints.length; i += AT_A_TIME) {
    postures.push(...(await api.kinematics({ robot_id: robot.id }, joints.slice(i, i + AT_A_TIME))).postures);
  }
  return postures;
}
