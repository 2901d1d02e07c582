/** The postures of all configurations of a set, asked for once. */
import { useMemo } from "preact/hooks";
import { api } from "../api/client";
import type { MeasurementSet, Posture, Robot } from "../api/types";
import { factors } from "../pure/units";
import { useLoad, valueOf } from "../state/load";

const AT_A_TIME = 500; // the service takes 1000 at most
const kept = new Map<string, Promise<Posture[]>>();

/** One posture an observation, or null while they are on their way. */
export function usePostures(set: MeasurementSet, robot: Robot): Posture[] | null {
  const loaded = useLoad(() => posturesOf(set, robot), [set.id]);
  return useMemo(() => valueOf(loaded), [loaded.state]);
}

function posturesOf(set: MeasurementSet, robot: Robot): Promise<Posture[]> {
  const before = kept.get(set.id);
  if (before) return before;
  const asked = ask(set, robot);
  kept.set(set.id, asked);
  asked.catch(() => kept.delete(set.id));
  return asked;
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
