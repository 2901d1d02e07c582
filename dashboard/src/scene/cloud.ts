/** Many places as points, each in a colour of its own. */
import { BufferGeometry, type Color, Float32BufferAttribute, Points, PointsMaterial } from "three";
import type { Vector } from "../lib/vector";

export class Cloud {
  readonly points = new Points(new BufferGeometry(), new PointsMaterial({ vertexColors: true, sizeAttenuation: true }));

  /** Draw these, as wide as `size` [m] for a camera of this field of view [degrees], which three.js leaves out. */
  set(places: Vector[], colors: Color[], size: number, view: number): void {
    this.points.geometry.dispose();
    this.points.geometry = new BufferGeometry();
    this.points.geometry.setAttribute("position", new Float32BufferAttribute(places.flat(), 3));
    this.points.geometry.setAttribute(
      "color",
      new Float32BufferAttribute(
        colors.flatMap(({ r, g, b }) => [r, g, b]),
        3,
      ),
    );
    this.points.material.size = size / Math.tan((view * Math.PI) / 360);
    this.points.visible = places.length > 0;
  }

  dispose(): void {
    this.points.geometry.dispose();
    this.points.material.dispose();
  }
}
