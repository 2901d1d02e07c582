/** The camera about a point: three's own controls turn and zoom; here it is held so that all is in view. */
import { type PerspectiveCamera, Sphere, Vector3 } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

const KEY_TURN = 0.12;
const ZOOM = 1.12;
/** Isometric: all three axes are seen alike. */
const CORNERS = [1, -1].flatMap((x) => [-1, 1].map((y) => new Vector3(x, y, 1).normalize()));
/** What has shrunk below this share of the view is framed anew. */
const SMALL = 0.62;

type Point = readonly [number, number, number];

export class Orbit {
  readonly #controls: OrbitControls;
  readonly #toward = new Vector3();
  #points: Vector3[] = [];
  /** What the view holds; zooming leaves it. */
  #held = new Sphere();
  #touched = false;

  constructor(
    readonly camera: PerspectiveCamera,
    canvas: HTMLCanvasElement,
    readonly changed: () => void,
  ) {
    const mayZoom = (event: Event) => {
      // else a wheel over the view scrolls the page on
      const asked = event instanceof WheelEvent ? event.ctrlKey || document.activeElement === canvas : true;
      this.#controls.enableZoom = asked;
    };
    canvas.addEventListener("wheel", mayZoom, { capture: true });
    canvas.addEventListener("pointerdown", mayZoom, { capture: true });
    canvas.addEventListener("keydown", (event) => this.#key(event));
    this.#controls = new OrbitControls(camera, canvas);
    this.#controls.enablePan = false;
    this.#controls.addEventListener("start", () => {
      this.#touched = true;
    });
    this.#controls.addEventListener("change", changed);
  }

  /** Distance from which the camera looks [m]. */
  get distance(): number {
    return this.#controls.getDistance();
  }

  /** Hold these points in view; the view stays still as long as they fit well, or someone has turned it. */
  frame(points: readonly Point[]): void {
    const first = this.#points.length === 0;
    this.#points = points.map((point) => new Vector3(...point));
    const within = this.#points.every((point) => this.#held.distanceToPoint(point) < 0.01 * this.#held.radius);
    const small = new Sphere().setFromPoints(this.#points).radius < SMALL * this.#held.radius;
    if (first) this.reset();
    else if (!this.#touched && (!within || small)) this.#refit();
  }

  /** Look anew at what is framed next. */
  forget(): void {
    this.#points = [];
  }

  /** Look from the corner from which the arm is seen most from its side. */
  reset(): void {
    const level = ({ x, y }: Vector3) => Math.hypot(x, y);
    const far = this.#points.reduce((most, point) => (level(point) > level(most) ? point : most), new Vector3(1, 0, 0));
    const side = ({ x, y }: Vector3) => Math.abs(far.x * y - far.y * x);
    this.#toward.copy(CORNERS.reduce((best, corner) => (side(corner) > side(best) + 1e-6 ? corner : best)));
    this.#touched = false;
    this.#refit();
  }

  #refit(): void {
    const { center, radius } = this.#held.setFromPoints(this.#points);
    const up = (this.camera.fov * Math.PI) / 360;
    const distance = radius / Math.sin(Math.min(up, Math.atan(Math.tan(up) * this.camera.aspect)));
    this.#controls.minDistance = distance / 12;
    this.#controls.maxDistance = distance / 0.3;
    this.camera.near = distance / 100;
    this.camera.far = distance * 30;
    this.camera.updateProjectionMatrix();
    this.#controls.target.copy(center);
    this.camera.position.copy(center).addScaledVector(this.#toward, distance);
    this.#controls.update();
    this.changed();
  }

  /** The size of the canvas has changed. */
  resized(): void {
    this.camera.updateProjectionMatrix();
    if (!this.#touched && this.#points.length > 0) this.#refit();
    else this.changed();
  }

  /** Stay while something else is dragged. */
  pause(paused: boolean): void {
    this.#controls.enabled = !paused;
  }

  dispose(): void {
    this.#controls.dispose();
  }

  #key(event: KeyboardEvent): void {
    const steps: Record<string, () => void> = {
      ArrowLeft: () => this.#controls.rotateLeft(-KEY_TURN),
      ArrowRight: () => this.#controls.rotateLeft(KEY_TURN),
      ArrowUp: () => this.#controls.rotateUp(KEY_TURN),
      ArrowDown: () => this.#controls.rotateUp(-KEY_TURN),
      "+": () => this.#controls.dollyIn(1 / ZOOM),
      "=": () => this.#controls.dollyIn(1 / ZOOM),
      "-": () => this.#controls.dollyOut(1 / ZOOM),
      "0": () => this.reset(),
    };
    const step = steps[event.key];
    if (!step || (event.shiftKey && event.key.startsWith("Arrow"))) return; // which pulls a force
    event.preventDefault();
    this.#touched = event.key !== "0";
    step();
  }
}
