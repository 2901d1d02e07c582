/** What a hand drags in the 3D view: a ball, found by a finger that is near it. */
import { type Intersection, Object3D, type PerspectiveCamera, type Raycaster, type Vector3 } from "three";
import type { Vector } from "../lib/vector";

/** Radii of a grip: what is seen, and what a finger finds [px]. */
export const [SEEN, FOUND] = [8, 22];

export const vectorOf = ({ x, y, z }: Vector3): Vector => [x, y, z];

/** Something to drag: of several under a finger the one whose middle is nearest to it is found. */
export class Handle extends Object3D {
  override raycast({ ray }: Raycaster, found: Intersection[]): void {
    const away = ray.distanceToPoint(this.position);
    if (away < this.scale.x) found.push({ distance: away / this.scale.x, point: this.position, object: this });
  }

  /** Be as large as a finger needs: `pixel` is the size of one at a distance of 1. */
  sized(camera: PerspectiveCamera, pixel: number): void {
    this.scale.setScalar(FOUND * pixel * camera.position.distanceTo(this.position));
  }
}
