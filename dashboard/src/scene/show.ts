/** What the 3D view is given. */
import type { Posture } from "../api/types";
import type { Box } from "../lib/box";
import type { Pull } from "../lib/pull";
import type { Vector } from "../lib/vector";
import type { Arrow } from "./parts";

/** What is shown. Lengths in m, R0. */
export interface Show {
  posture: Posture;
  measured: Arrow[];
  predicted: Arrow[];
  load: Arrow | null;
  /** By how much deflections are exaggerated. */
  factor: number;
  axes: boolean;
  /** Names of the joints; none: no labels. */
  names: string[];
  /** Names of the targets of the measured arrows. */
  targets: string[];
  /** Lengths of the residuals of the measured arrows [m]. */
  residuals: number[];
  /** Greatest residual of the set [m], if arrows are coloured by their residual. */
  byResidual: number | null;
  /** Angles by which the joints give way [rad]. */
  bend: number[];
  /** What each joint contributes to the deflection, as a share of the greatest; null, or none at all: no colour. */
  shares: (number | null)[];
  /** Index of the joint that was chosen: it has a band, its axis, and its name before all others. */
  chosen: number | null;
  /** Places of a map: where [m], their share of the colours, and how wide one is drawn [m]. */
  cloud?: { places: Vector[]; shares: number[]; size: number };
  /** A box that is dragged. */
  box?: Box;
  /** The force that is pulled, in place of a load. */
  pull?: Pull;
}
