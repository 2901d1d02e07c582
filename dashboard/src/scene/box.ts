/** A box in the 3D view, loaded where one is shown; its faces and its middle are dragged by three's own controls. */
import {
  BufferGeometry,
  type Color,
  DoubleSide,
  Float32BufferAttribute,
  Group,
  LineBasicMaterial,
  LineSegments,
  Mesh,
  MeshBasicMaterial,
  type PerspectiveCamera,
  SphereGeometry,
  Vector3,
} from "three";
import { DragControls } from "three/addons/controls/DragControls.js";
import { type Box, dragged, GRIPS, placeOf } from "../lib/box";
import { subtract, type Vector } from "../lib/vector";
import { FOUND, Handle, SEEN, vectorOf } from "./handle";

const MIDDLE = 3; // of the materials

/** Corners of a box of length one by the bits of their numbers, pairs of corners that differ in one bit, and faces. */
const CORNERS = [0, 1, 2, 3, 4, 5, 6, 7].flatMap((corner) => [1, 2, 4].map((bit) => (corner & bit ? 0.5 : -0.5)));
const EDGES = [1, 2, 4].flatMap((bit) => [0, 1, 2, 3, 4, 5, 6, 7].flatMap((i) => (i & bit ? [] : [i, i | bit])));
const FACES = [
  [1, 2, 4],
  [2, 4, 1],
  [4, 1, 2],
].flatMap(([side = 0, u = 0, v = 0]) => [0, side].flatMap((at) => [at, at | u, at | u | v, at, at | u | v, at | v]));

/** Lines or triangles between the corners. */
const between = (corners: number[]): BufferGeometry =>
  new BufferGeometry().setAttribute("position", new Float32BufferAttribute(CORNERS, 3)).setIndex(corners);

export class HeldBox extends Group {
  readonly #edges = new LineSegments(between(EDGES), new LineBasicMaterial());
  readonly #inside = new Mesh(
    between(FACES),
    new MeshBasicMaterial({ transparent: true, opacity: 0.14, depthWrite: false, side: DoubleSide }),
  );
  readonly #sphere = new SphereGeometry(1, 18, 12);
  /** Of the grips along x, y and z, and of the middle: seen through the arm, as they are dragged through it. */
  readonly #balls = [0, 1, 2, 3].map(() => new MeshBasicMaterial({ depthTest: false, transparent: true }));
  readonly #grips = GRIPS.map(() => new Handle());
  readonly #controls: DragControls;
  #box: Box = [
    [0, 0, 0],
    [0, 0, 0],
  ];
  /** What is dragged, with where it and the box were. */
  #held: { box: Box; from: Vector } | null = null;

  /** `holds` hears when something is dragged, and when no longer; `changed` of each new box. */
  constructor(
    camera: PerspectiveCamera,
    canvas: HTMLCanvasElement,
    holds: (held: boolean) => void,
    changed: (box: Box) => void,
  ) {
    super();
    this.#grips.forEach((grip, i) => {
      const kind = GRIPS[i] ?? "middle";
      const ball = new Mesh(this.#sphere, this.#balls[kind === "middle" ? MIDDLE : kind.axis]);
      ball.scale.setScalar(SEEN / FOUND);
      ball.renderOrder = 2;
      grip.add(ball);
    });
    this.add(this.#edges, this.#inside, ...this.#grips);
    this.#controls = new DragControls(this.#grips, camera, canvas);
    this.#controls.recursive = false;
    this.#controls.addEventListener("dragstart", ({ object }) => {
      this.#held = { box: this.#box, from: vectorOf(object.position) };
      holds(true);
    });
    this.#controls.addEventListener("drag", ({ object }) => {
      const grip = GRIPS[this.#grips.findIndex((each) => each === object)];
      if (!this.#held || !grip) return;
      const look = vectorOf(camera.getWorldDirection(new Vector3()));
      this.#put(dragged(this.#held.box, grip, subtract(vectorOf(object.position), this.#held.from), look));
      changed(this.#box);
    });
    this.#controls.addEventListener("dragend", () => {
      this.#held = null;
      holds(false);
    });
  }

  /** Draw this box; while one is dragged, the hand has the say. */
  set(box: Box): void {
    if (!this.#held) this.#put(box);
  }

  /** `axes`: colours of x, y and z. */
  paint(color: Color, axes: Color[]): void {
    this.#edges.material.color = color;
    this.#inside.material.color = color;
    this.#balls.forEach((ball, i) => {
      ball.color = axes[i] ?? color;
    });
  }

  /** Draw the grips as large as a finger needs: `pixel` is the size of one at a distance of 1. */
  sized(camera: PerspectiveCamera, pixel: number): void {
    for (const grip of this.#grips) grip.sized(camera, pixel);
  }

  #put(box: Box): void {
    this.#box = box;
    for (const part of [this.#edges, this.#inside]) {
      part.position.set(...placeOf(box, "middle"));
      part.scale.set(...subtract(box[1], box[0]));
    }
    this.#grips.forEach((grip, i) => grip.position.set(...placeOf(box, GRIPS[i] ?? "middle")));
  }

  override dispose(): void {
    this.#controls.dispose();
    for (const part of [this.#edges, this.#inside]) {
      part.geometry.dispose();
      part.material.dispose();
    }
    this.#sphere.dispose();
    for (const ball of this.#balls) ball.dispose();
  }
}
