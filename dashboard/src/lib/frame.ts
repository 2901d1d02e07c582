/** The frame that positions are in, as people state it: the robot's base, or that of a tracker. */
import type { MeasurementSet } from "../api/types";
import { vectorIn } from "./entered";

export type Frame = NonNullable<MeasurementSet["frame"]>;

export interface StatedFrame {
  /** "" for R0, "transform", or the id of a geometry. */
  of: string;
  /** The tracker's origin in R0, in the files' unit of length. */
  translation: string;
  /** Rotation matrix, tracker to R0. */
  rows: [string, string, string];
  forces: "base" | "tracker";
}

export const IN_R0: StatedFrame = { of: "", translation: "", rows: ["1, 0, 0", "0, 1, 0", "0, 0, 1"], forces: "base" };

/** The frame to post: null for R0, undefined while numbers are missing. */
export function frameOf({ of, translation, rows, forces }: StatedFrame): Partial<Frame> | null | undefined {
  if (of === "") return null;
  if (of !== "transform") return { geometry_id: of, forces };
  const origin = vectorIn(translation);
  const rotation = rows.map(vectorIn);
  if (!origin || rotation.some((row) => !row)) return undefined;
  return { rotation: rotation as Frame["rotation"], translation: origin, forces };
}
