/** Parts of the 3D view: the arm, arrows, points, names above the picture, and a bar for the scale. */
import {
  CylinderGeometry,
  Group,
  Mesh,
  MeshLambertMaterial,
  SphereGeometry,
  Vector3,
  BufferGeometry,
  Color,
  ConeGeometry,
  Float32BufferAttribute,
  InstancedMesh,
  Object3D,
  Points,
  PointsMaterial,
  type PerspectiveCamera,
  type Scene,
} from "three";
import { CSS2DObject, CSS2DRenderer } from "three/addons/renderers/CSS2DRenderer.js";
import type { Posture } from "../api/types";
import { add, norm, subtract, times, type Vector } from "../lib/vector";
import { significant, roundStep } from "../lib/format";
import { sceneWords } from "./words";

const UP = new Vector3(0, 1, 0);

/** Lay something that is one long and stands upright from a place along a vector. */
function lay(part: Object3D, from: Vector, along: Vector, radius: number): Object3D {
  const length = norm(along) || 1e-9;
  part.quaternion.setFromUnitVectors(UP, new Vector3(...times(along, 1 / length)));
  part.position.set(...add(from, times(along, 0.5)));
  part.scale.set(radius, length, radius);
  return part;
}

export class Arm extends Group {
  readonly axes = new Group();
  readonly linkMaterial = new MeshLambertMaterial();
  readonly jointMaterial = new MeshLambertMaterial();
  readonly axisMaterial = new MeshLambertMaterial();
  readonly baseMaterial = new MeshLambertMaterial();
  readonly chosenMaterial = new MeshLambertMaterial();
  readonly #cylinder = new CylinderGeometry(1, 1, 1, 20);
  readonly #sphere = new SphereGeometry(1, 20, 14);
  /** Of joints that have a colour of their own. */
  #jointMaterials: (MeshLambertMaterial | null)[] = [];
  /** Index of the joint that was chosen. */
  #chosen: number | null = null;
  /** By what they are, made when they are first needed. */
  readonly #parts = new Map<string, Mesh>();

  constructor() {
    super();
    this.add(this.axes);
  }

  /** Put the arm into a posture; `reach` sets how thick it is. */
  set(posture: Posture, reach: number): void {
    const points: Vector[] = [[0, 0, 0], ...posture.joint_origins, posture.flange_origin];
    const thick = (i: number) => reach * (0.046 - (0.028 * i) / Math.max(1, points.length - 1));
    lay(this.#part("pedestal", this.baseMaterial), [0, 0, 0], [0, 0, reach * 0.05], reach * 0.13);
    points.forEach((point, i) => {
      const ball = this.#part(`ball ${i}`, this.linkMaterial, this.#sphere);
      ball.position.set(...point);
      ball.scale.setScalar(thick(i));
      const next = points[i + 1];
      if (next) lay(this.#part(`tube ${i}`, this.linkMaterial), point, subtract(next, point), thick(i));
    });
    const band = this.#part("band", this.chosenMaterial);
    const chosenAxis = this.#part("chosen axis", this.chosenMaterial);
    band.visible = this.#chosen !== null;
    chosenAxis.visible = this.#chosen !== null;
    posture.joint_axes.forEach((axis, j) => {
      const origin = posture.joint_origins[j] ?? [0, 0, 0];
      const about = (part: Mesh, half: number, radius: number) =>
        lay(part, subtract(origin, times(axis, half)), times(axis, 2 * half), radius);
      const drum = thick(j + 1) * 1.5;
      const joint = this.#part(`drum ${j}`, this.jointMaterial);
      joint.material = this.#jointMaterials[j] ?? this.jointMaterial;
      about(joint, drum * 0.9, drum * 0.86);
      about(this.#part(`axis ${j}`, this.axisMaterial, this.#cylinder, this.axes), reach * 0.13, reach * 0.0035);
      if (j !== this.#chosen) return;
      about(band, drum * 0.4, drum * 1.12);
      about(chosenAxis, reach * 0.16, reach * 0.007);
    });
  }

  /** Give a joint a band and its axis, from the next `set` on; null for none. */
  choose(joint: number | null): void {
    this.#chosen = joint;
  }

  /** Give joints colours of their own, from the next `set` on; the others have that of `jointMaterial`. */
  paintJoints(colors: (Color | null)[]): void {
    for (const material of this.#jointMaterials) material?.dispose();
    this.#jointMaterials = colors.map((color) => color && new MeshLambertMaterial({ color }));
  }

  #part(
    name: string,
    material: MeshLambertMaterial,
    geometry: BufferGeometry = this.#cylinder,
    group: Group = this,
  ): Mesh {
    const mesh = this.#parts.get(name) ?? new Mesh(geometry, material);
    if (!this.#parts.has(name)) group.add(mesh);
    this.#parts.set(name, mesh);
    return mesh;
  }

  override dispose(): void {
    this.paintJoints([]);
    this.#cylinder.dispose();
    this.#sphere.dispose();
  }
}

export interface Arrow {
  from: Vector;
  along: Vector;
}
const WHITE = new Color(1, 1, 1);

export class Arrows extends Group {
  readonly material = new MeshLambertMaterial();
  #shafts: InstancedMesh | null = null;
  #heads: InstancedMesh | null = null;
  readonly #laid = new Object3D();

  /** Draw these, their length times a factor, as thick as `radius`, each in a colour of its own if given. */
  set(arrows: Arrow[], factor: number, radius: number, colors: Color[] | null = null): void {
    this.#reserve(arrows.length);
    arrows.forEach(({ from, along }, i) => this.#put(i, from, times(along, factor), radius));
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

  #put(i: number, from: Vector, along: Vector, radius: number): void {
    const length = norm(along);
    const thick = length > 0 ? Math.min(radius, length / 4) : 1e-9;
    const head = times(along, Math.min((radius * 6) / (length || 1), 0.5));
    const shaft = subtract(along, head);
    const put = (mesh: InstancedMesh | null, start: Vector, part: Vector, wide: number) => {
      lay(this.#laid, start, part, wide).updateMatrix();
      mesh?.setMatrixAt(i, this.#laid.matrix);
    };
    put(this.#shafts, from, shaft, thick);
    put(this.#heads, add(from, shaft), head, thick * 2.4);
  }

  #reserve(count: number): void {
    if (this.#shafts && this.#shafts.instanceMatrix.count >= count) return;
    this.dispose();
    const room = Math.max(8, count);
    this.#shafts = new InstancedMesh(new CylinderGeometry(1, 1, 1, 8), this.material, room);
    this.#heads = new InstancedMesh(new ConeGeometry(1, 1, 12), this.material, room);
    for (const mesh of [this.#shafts, this.#heads]) mesh.frustumCulled = false; // the instances move
    this.add(this.#shafts, this.#heads);
  }

  override dispose(): void {
    for (const mesh of [this.#shafts, this.#heads]) {
      if (!mesh) continue;
      this.remove(mesh);
      mesh.geometry.dispose();
      mesh.dispose();
    }
  }
}

export class Cloud extends Points<BufferGeometry, PointsMaterial> {
  constructor() {
    super(new BufferGeometry(), new PointsMaterial({ vertexColors: true, sizeAttenuation: true }));
  }

  /** Draw these, as wide as `size` [m] for a camera of this field of view [degrees], which three.js leaves out. */
  set(places: Vector[], colors: Color[], size: number, view: number): void {
    this.geometry.dispose();
    this.geometry = new BufferGeometry();
    this.geometry.setAttribute("position", new Float32BufferAttribute(places.flat(), 3));
    const parts = colors.flatMap(({ r, g, b }) => [r, g, b]);
    this.geometry.setAttribute("color", new Float32BufferAttribute(parts, 3));
    this.material.size = size / Math.tan((view * Math.PI) / 360);
    this.visible = places.length > 0;
  }

  override dispose(): void {
    this.geometry.dispose();
    this.material.dispose();
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
    const shown = sceneWords.scale(significant(length, 1), deflection);
    if (this.#words.textContent !== shown) this.#words.textContent = shown;
  }

  dispose(): void {
    this.#box.remove();
  }
}

export interface Label {
  name: string;
  at: Vector;
  kind: "joint" | "chosen" | "target" | "x" | "y" | "z";
}

const [LEAST_GAP, BESIDE] = [17, 20]; // px
/** To the right of the point, to its left, below, above, further away: the first that is free is taken. */
const PLACES = [0, 18, -18, 36, -36, 54, -54].flatMap((below) => [1, -1].map((side) => [side, below] as const));

/** Names at their points by three's renderer of elements, moved apart here; one without a free place is left out. */
export class Labels extends Group {
  readonly #renderer = new CSS2DRenderer();
  readonly #point = new Vector3();
  /** Labels in the order in which they take places, with their sizes [px]. */
  #labels: { label: CSS2DObject; kind: Label["kind"]; wide: number; high: number }[] = [];

  constructor(beside: HTMLElement) {
    super();
    const { domElement } = this.#renderer;
    domElement.className = "scene-labels";
    domElement.setAttribute("aria-hidden", "true");
    beside.parentElement?.append(domElement);
  }

  set(labels: Label[]): void {
    this.clear(); // which removes their elements, too
    const made = labels.map(({ name, at, kind }) => {
      const element = document.createElement("span");
      element.className = kind === "joint" ? "" : kind;
      element.textContent = name;
      const label = new CSS2DObject(element);
      label.position.set(...at);
      return { label, kind };
    });
    this.add(...made.map(({ label }) => label));
    this.#renderer.domElement.append(...made.map(({ label }) => label.element));
    this.#labels = made.map((each) => ({
      ...each,
      wide: each.label.element.offsetWidth || 1,
      high: each.label.element.offsetHeight || 1,
    }));
  }

  render(scene: Scene, camera: PerspectiveCamera): void {
    this.#part(camera);
    this.#renderer.render(scene, camera);
  }

  resized(width: number, height: number): void {
    this.#renderer.setSize(width, height);
  }

  /** Choose the side of its point on which each label is. */
  #part(camera: PerspectiveCamera): void {
    const { width, height } = this.#renderer.getSize();
    const taken: [number, number, number][] = [];
    for (const { label, kind, wide, high } of this.#labels) {
      const { x, y, z } = this.#point.copy(label.position).project(camera);
      const [left, top] = [((x + 1) / 2) * width, ((1 - y) / 2) * height];
      const most = Math.max(0, width - wide - BESIDE); // the label and its gap stay in the window
      const within = (v: number) => Math.min(height - high, Math.max(high, v));
      const free = PLACES.map(
        ([side, below]) =>
          [Math.min(most, Math.max(0, left + (side < 0 ? -wide - BESIDE : 0))), within(top + below)] as const,
      ).find(([u, v]) => !taken.some(([x1, y1, w]) => u < x1 + w && x1 < u + wide && Math.abs(v - y1) < LEAST_GAP));
      label.visible = free !== undefined && z <= 1 && left >= 0 && left <= width && top >= 0 && top <= height;
      if (!label.visible || !free) continue;
      if (kind === "joint" || kind === "chosen" || kind === "target") taken.push([free[0], free[1], wide]);
      label.center.set((left - free[0]) / wide, (top - free[1]) / high); // the anchor, as a share of the label
    }
  }

  override dispose(): void {
    this.clear();
    this.#renderer.domElement.remove();
  }
}
