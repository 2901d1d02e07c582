/** Robots and measurement sets, which never change while they are stored: each is asked for once. */
import { api } from "../api/client";
import type { MeasurementSet, Robot } from "../api/types";
import { cached, forget } from "./cache";

export const storedSet = (id: string): Promise<MeasurementSet> => cached(`set/${id}`, () => api.set(id));
export const storedRobot = (id: string): Promise<Robot> => cached(`robot/${id}`, () => api.robot(id));

/** A robot or a set was deleted, or restored. */
export function storedChanged(): void {
  forget("set/");
  forget("robot/");
}
