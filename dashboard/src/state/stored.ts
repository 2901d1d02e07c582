/** Robots and measurement sets. Sets never change but by what is noted of them; alarms of robots come and go. */
import { api } from "../api/client";
import type { MeasurementSet, Robot } from "../api/types";
import { cached, forget } from "./cache";

export const storedSet = (id: string): Promise<MeasurementSet> => cached(`set/${id}`, () => api.sets.one(id));
export const storedRobot = (id: string): Promise<Robot> => cached(`robot/${id}`, () => api.robots.one(id), 2_000);

/** A robot or a set was deleted, restored or renamed, or its metadata changed. */
export function storedChanged(): void {
  forget("set/");
  forget("robot/");
}
