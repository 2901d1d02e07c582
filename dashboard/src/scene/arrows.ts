/** Many arrows in two draw calls: shafts and heads as instances. */
import {
  Color,
  ConeGeometry,
  CylinderGeometry,
  Group,
  InstancedMesh,
  Matrix4,
  MeshLambertMaterial,
  Quaternion,
  Vector3,
} from "three";
import type { Vector } from "../lib/vector";

export interface Arrow {
  from: Vector;
  along: Vector;
}

const UP = new Vector3(0, 1, 0);
const WHITE = new Color(1, 1, 1);

export class Arrows {
  readonly group = new Group();
  readonly material = new MeshLambertMaterial();
  #shafts: InstancedMesh | null = null;
  #heads: InstancedMesh | null = null;
  readonly #matrix = new Matrix4();
  readonly #turn = new Quaternion();
  readonly #place = new Vector3();
  readonly #direction = new Vector3();
  readonly #scale = new Vector3();

  /** Draw these, their length times a factor, as thick as `radius`, each in a colour of its own if given. */
  set(arrows: Arrow[], factor: number, radius: number, colors: Color[] | null = null): void {
    this.#reserve(arrows.length);
    arrows.forEach(({ from, along }, i) => this.#put(i, from, along, factor, radius));
    for (const mesh of [this.#shafts, this.#heads]) {
      if (!mesh) continue;
      mesh.count = arrows.length;
      mesh.instanceMatrix.needsUpdate = true;
      arrows.forEach((_, i) => mesh.setColorAt(i, colors?.[i] ?? WHITE));
      if (mesh.instanceColor) mesh.instanceColor.needsUpdate = true;
    }
  }

  /** Half of it shines by itself, so that an arrow has the colour of the legend from all sides. */
  paint(color: Color, instances = false): void {
    this.material.color = color;
    this.material.emissive = color;
    this.material.emissiveIntensity = instances ? 0 : 0.5; // of instances it would be white
  }

  #put(i: number, from: Vector, along: Vector, factor: number, radius: number): void {
    this.#direction.set(...along).multiplyScalar(factor);
    const length = this.#direction.length();
    const head = Math.min(radius * 6, length * 0.5);
    const thick = length > 0 ? Math.min(radius, length / 4) : 1e-9;
    if (length > 0) this.#turn.setFromUnitVectors(UP, this.#direction.divideScalar(length));
    this.#place.set(...from).addScaledVector(this.#direction, (length - head) / 2);
    this.#matrix.compose(this.#place, this.#turn, this.#scale.set(thick, Math.max(1e-9, length - head), thick));
    this.#shafts?.setMatrixAt(i, this.#matrix);
    this.#place.set(...from).addScaledVector(this.#direction, length - head / 2);
    this.#matrix.compose(this.#place, this.#turn, this.#scale.set(thick * 2.4, Math.max(1e-9, head), thick * 2.4));
    this.#heads?.setMatrixAt(i, this.#matrix);
  }

  #reserve(count: number): void {
    if (this.#shafts && this.#shafts.instanceMatrix.count >= count) return;
    this.dispose();
    const room = Math.max(8, count);
    this.#shafts = new InstancedMesh(new CylinderGeometry(1, 1, 1, 8), this.material, room);
    this.#heads = new InstancedMesh(new ConeGeometry(1, 1, 12), this.material, room);
    for (const mesh of [this.#shafts, this.#heads]) mesh.frustumCulled = false; // the instances move
    this.group.add(this.#shafts, this.#heads);
  }

  dispose(): void {
    for (const mesh of [this.#shafts, this.#heads]) {
      if (!mesh) continue;
      this.group.remove(mesh);
      mesh.geometry.dispose();
      mesh.dispose();
    }
  }
}
