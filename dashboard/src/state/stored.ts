/** Robots and measurement sets, whose readings and kinematics never change: each is asked for once. */
import { api } from "../api/client";
import type { MeasurementSet, Robot } from "../api/types";
import { cached, forget } from "./cache";

export const storedSet = (id: string): Promise<MeasurementSet> => cached(`set/${id}`, () => api.sets.one(id));
export const storedRobot = (id: string): Promise<Robot> => cached(`robot/${id}`, () => api.robots.one(id));

/** A robot or a set was deleted, restored or renamed, or its metadata changed. */
export function storedChanged(): void {
  forget("set/");
  forget("robot/");
}
