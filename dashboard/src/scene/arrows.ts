/** Many arrows in two draw calls: shafts and heads as instances. */
import { significant } from "../lib/format";
import { roundStep } from "../lib/scale";
import { text } from "../i18n";
import {
  BufferGeometry,
  Color,
  ConeGeometry,
  CylinderGeometry,
  Float32BufferAttribute,
  Group,
  InstancedMesh,
  Matrix4,
  MeshLambertMaterial,
  Points,
  PointsMaterial,
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

const WANTED = 130;

export class ScaleBar {
  readonly #box = document.createElement("div");
  readonly #line = document.createElement("i");
  readonly #words = document.createElement("span");

  constructor(beside: HTMLElement) {
    this.#box.className = "scale-bar";
    this.#box.setAttribute("aria-hidden", "true");
    this.#box.append(this.#line, this.#words);
    beside.parentElement?.append(this.#box);
  }

  /** `metre`: pixels of a metre at the centre of the view; `factor`: by how much deflections are drawn longer. */
  set(metre: number, factor: number): void {
    const length = roundStep(WANTED / metre / 2, 1);
    this.#line.style.width = `${Math.round(length * metre)}px`;
    const deflection = factor === 1 ? null : significant((length / factor) * 1e3, 1);
    const shown = text.scene.scale(significant(length, 1), deflection);
    if (this.#words.textContent !== shown) this.#words.textContent = shown;
  }

  dispose(): void {
    this.#box.remove();
  }
}
