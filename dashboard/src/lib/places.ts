/** Where loads act and targets are, in R0 and SI: what it takes to draw them. */
import type { MeasurementSet, Observation, Posture } from "../api/types";
import { factors } from "./units";
import { add, fromFlange, times, turned, type Vector } from "./vector";

/** Where the load acts and what it is, R0, SI. */
export interface Load {
  point: Vector;
  force: Vector;
}

export function loadOf(set: MeasurementSet, observation: Observation, posture: Posture): Load {
  const unit = factors(set.units);
  const inFlange = observation.load_point ?? set.load_point ?? [0, 0, 0];
  const axes = set.frame?.forces === "tracker" ? set.resolved_frame?.rotation : undefined;
  const inBase = (vector: Vector): Vector => (axes ? turned(axes, vector) : vector);
  return {
    point: fromFlange(posture.flange_origin, posture.flange_axes, times(inFlange, unit.length)),
    force: inBase(times(observation.force, unit.force)),
  };
}

/** Where the targets are before the load, R0 [m]: as read, or by the model where only a deflection is known. */
export function placesOf(set: MeasurementSet, observation: Observation, posture: Posture): Map<string, Vector> {
  const { length } = factors(set.units);
  const frame = set.resolved_frame;
  const places = new Map<string, Vector>();
  for (const { target, unloaded } of observation.readings) {
    const stated = set.flange_targets?.[target];
    const onFlange = stated ? times(stated, length) : frame?.flange_targets[target];
    if (unloaded) {
      const read = times(unloaded, length);
      places.set(target, frame ? add(frame.translation, turned(frame.rotation, read)) : read);
    } else if (onFlange) places.set(target, fromFlange(posture.flange_origin, posture.flange_axes, onFlange));
  }
  return places;
}
