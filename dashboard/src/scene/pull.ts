/** The head of a force in the 3D view, loaded where one is pulled: dragged by three's own controls, or moved by keys. */
import { type Color, Group, Mesh, MeshBasicMaterial, type PerspectiveCamera, SphereGeometry, Vector3 } from "three";
import { DragControls } from "three/addons/controls/DragControls.js";
import { forceAt, forceByKey, headOf, type Pull } from "../lib/pull";
import type { Vector } from "../lib/vector";
import { FOUND, Handle, SEEN, vectorOf } from "./handle";

export class HeldForce extends Group {
  readonly #grip = new Handle();
  readonly #ball = new Mesh(
    new SphereGeometry(1, 18, 12),
    new MeshBasicMaterial({ depthTest: false, transparent: true }),
  );
  readonly #controls: DragControls;
  readonly #end = new AbortController();
  #pull: Pull = { from: [0, 0, 0], force: [0, 0, 0], scale: 1 };
  #held = false;

  /** `holds` hears when the force is dragged, and when no longer; `changed` of each new force. */
  constructor(
    camera: PerspectiveCamera,
    canvas: HTMLCanvasElement,
    holds: (held: boolean) => void,
    changed: (force: Vector) => void,
  ) {
    super();
    this.#ball.scale.setScalar(SEEN / FOUND);
    this.#ball.renderOrder = 2;
    this.#grip.add(this.#ball);
    this.add(this.#grip);
    const put = (force: Vector) => {
      const before = this.#pull.force;
      this.#put({ ...this.#pull, force });
      if (force.some((part, i) => part !== before[i])) changed(force);
    };
    this.#controls = new DragControls([this.#grip], camera, canvas);
    this.#controls.recursive = false;
    this.#controls.addEventListener("dragstart", () => {
      this.#held = true;
      holds(true);
    });
    this.#controls.addEventListener("drag", () => put(forceAt(this.#pull, vectorOf(this.#grip.position))));
    this.#controls.addEventListener("dragend", () => {
      this.#held = false;
      holds(false);
    });
    const byKey = (event: KeyboardEvent) => {
      if (!event.shiftKey || !this.visible) return;
      const right = vectorOf(new Vector3().setFromMatrixColumn(camera.matrixWorld, 0));
      const force = forceByKey(this.#pull.force, event.key, right);
      if (!force) return;
      event.preventDefault();
      put(force);
    };
    canvas.addEventListener("keydown", byKey, { signal: this.#end.signal });
  }

  /** Draw this force; while one is dragged, the hand has the say. */
  set(pull: Pull): void {
    if (!this.#held) this.#put(pull);
  }

  paint(color: Color): void {
    this.#ball.material.color = color;
  }

  sized(camera: PerspectiveCamera, pixel: number): void {
    this.#grip.sized(camera, pixel);
  }

  #put(pull: Pull): void {
    this.#pull = pull;
    this.#grip.position.set(...headOf(pull));
  }

  override dispose(): void {
    this.#end.abort();
    this.#controls.dispose();
    this.#ball.geometry.dispose();
    this.#ball.material.dispose();
  }
}
