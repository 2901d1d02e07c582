/** The arm: capsules between the joints' origins, a drum along each axis, the flange's frame. */
import { CylinderGeometry, Group, Mesh, MeshLambertMaterial, Quaternion, SphereGeometry, Vector3 } from "three";
import type { Posture } from "../api/types";
import { add, norm, subtract, times, type Vector } from "../lib/vector";

const UP = new Vector3(0, 1, 0);

export class Arm {
  readonly group = new Group();
  readonly axes = new Group();
  readonly linkMaterial = new MeshLambertMaterial();
  readonly jointMaterial = new MeshLambertMaterial();
  readonly axisMaterial = new MeshLambertMaterial();
  readonly baseMaterial = new MeshLambertMaterial();
  readonly #cylinder = new CylinderGeometry(1, 1, 1, 20);
  readonly #sphere = new SphereGeometry(1, 20, 14);
  readonly #tubes: Mesh[] = [];
  readonly #balls: Mesh[] = [];
  readonly #drums: Mesh[] = [];
  readonly #lines: Mesh[] = [];
  readonly #pedestal: Mesh;
  readonly #turn = new Quaternion();
  readonly #direction = new Vector3();

  constructor() {
    this.group.add(this.axes);
    this.#pedestal = this.#add(this.group, this.#cylinder, this.baseMaterial);
  }

  /** Put the arm into a posture; `reach` sets how thick it is. */
  set(posture: Posture, reach: number): void {
    const points: Vector[] = [[0, 0, 0], ...posture.joint_origins, posture.flange_origin];
    const thick = (i: number) => reach * (0.046 - (0.028 * i) / Math.max(1, points.length - 1));
    this.#span(this.#pedestal, [0, 0, 0], [0, 0, reach * 0.05], reach * 0.13);
    this.#grow(points.length, posture.joint_axes.length);
    points.forEach((point, i) => {
      this.#balls[i]?.position.set(...point);
      this.#balls[i]?.scale.setScalar(thick(i));
      const next = points[i + 1];
      if (next) this.#span(this.#tubes[i], point, next, thick(i));
    });
    posture.joint_axes.forEach((axis, j) => {
      const origin = posture.joint_origins[j] ?? [0, 0, 0];
      const drum = thick(j + 1) * 1.5;
      this.#span(
        this.#drums[j],
        subtract(origin, times(axis, drum * 0.9)),
        add(origin, times(axis, drum * 0.9)),
        drum * 0.86,
      );
      this.#span(
        this.#lines[j],
        subtract(origin, times(axis, reach * 0.13)),
        add(origin, times(axis, reach * 0.13)),
        reach * 0.0035,
      );
    });
  }

  #span(mesh: Mesh | undefined, from: Vector, to: Vector, radius: number): void {
    if (!mesh) return;
    const along = subtract(to, from);
    const length = norm(along);
    mesh.visible = length > 1e-9;
    if (!mesh.visible) return;
    this.#direction.set(...along).divideScalar(length);
    mesh.quaternion.copy(this.#turn.setFromUnitVectors(UP, this.#direction));
    mesh.position.set(...times(add(from, to), 0.5));
    mesh.scale.set(radius, length, radius);
  }

  #grow(points: number, joints: number): void {
    while (this.#balls.length < points) this.#balls.push(this.#add(this.group, this.#sphere, this.linkMaterial));
    while (this.#tubes.length < points - 1) this.#tubes.push(this.#add(this.group, this.#cylinder, this.linkMaterial));
    while (this.#drums.length < joints) this.#drums.push(this.#add(this.group, this.#cylinder, this.jointMaterial));
    while (this.#lines.length < joints) this.#lines.push(this.#add(this.axes, this.#cylinder, this.axisMaterial));
  }

  #add(group: Group, geometry: CylinderGeometry | SphereGeometry, material: MeshLambertMaterial): Mesh {
    const mesh = new Mesh(geometry, material);
    group.add(mesh);
    return mesh;
  }

  dispose(): void {
    this.#cylinder.dispose();
    this.#sphere.dispose();
  }
}
