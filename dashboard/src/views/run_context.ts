/** What the parts of a run's page share. */
import type { MeasurementSet, Robot, Run } from "../api/types";

/** A run with what it is about. */
export interface RunContext {
  run: Run;
  set: MeasurementSet;
  robot: Robot;
}

/** Whether more than the joints may bend, each by itself. */
export const isElastic = (run: Run): boolean => (run.request.elasticity ?? "joints") !== "joints";
