/** Orbiting a camera about a point: one finger or the mouse turns, two fingers or the wheel zoom, keys do both. */
import type { PerspectiveCamera } from "three";

const TURN = 0.008; // radians a pixel
const KEY_TURN = 0.12;
const ZOOM = 1.12;
/** Isometric: all three axes are seen alike. */
const ISOMETRIC = Math.atan(Math.SQRT1_2);
const CORNERS = [-0.25, 0.25, -0.75, 0.75].map((turns) => turns * Math.PI);
/** Share of the window that is left free around what is shown. */
const MARGIN = 1.16;
/** What has shrunk below this share of the view is framed anew. */
const SMALL = 0.62;

type Point = readonly [number, number, number];

export class Orbit {
  #azimuth: number = CORNERS[0] as number;
  #elevation = ISOMETRIC;
  #zoom = 1;
  #center: [number, number, number] = [0, 0, 0];
  #distance = 1;
  #points: readonly Point[] = [];
  #touched = false;
  readonly #pointers = new Map<number, [number, number]>();

  constructor(
    readonly camera: PerspectiveCamera,
    canvas: HTMLCanvasElement,
    readonly changed: () => void,
  ) {
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      this.#pointers.set(event.pointerId, [event.clientX, event.clientY]);
    });
    canvas.addEventListener("pointermove", (event) => this.#drag(event));
    for (const end of ["pointerup", "pointercancel"] as const) {
      canvas.addEventListener(end, (event) => this.#pointers.delete(event.pointerId));
    }
    canvas.addEventListener("wheel", (event) => this.#wheel(event), { passive: false });
    canvas.addEventListener("keydown", (event) => this.#key(event));
  }

  /** Distance from which the camera looks [m]. */
  get distance(): number {
    return this.#distance / this.#zoom;
  }

  /** Hold these points in view; the view stays still as long as they fit well, or someone has turned it. */
  frame(points: readonly Point[]): void {
    const first = this.#points.length === 0;
    this.#points = points;
    if (first) this.reset();
    if (first || this.#touched) return;
    const needed = this.#fit(this.#center);
    if (needed > this.#distance || needed < SMALL * this.#distance) this.#refit();
  }

  /** Look from the corner from which the arm is seen most from its side. */
  reset(): void {
    const [x, y] = this.#farthest();
    const side = (azimuth: number) => Math.abs(Math.sin(Math.atan2(y, x) - azimuth));
    this.#azimuth = CORNERS.reduce((best, corner) => (side(corner) > side(best) + 1e-6 ? corner : best));
    [this.#elevation, this.#zoom, this.#touched] = [ISOMETRIC, 1, false];
    this.#refit();
  }

  #farthest(): Point {
    return this.#points.reduce<Point>(
      (far, p) => (Math.hypot(p[0], p[1]) > Math.hypot(far[0], far[1]) ? p : far),
      [1, 0, 0],
    );
  }

  #refit(): void {
    const ends = ([0, 1, 2] as const).map((i) => {
      const values = this.#points.map((p) => p[i]);
      return (Math.min(...values) + Math.max(...values)) / 2;
    });
    this.#center = ends as [number, number, number];
    this.#distance = this.#fit(this.#center);
    this.#place();
  }

  /** Least distance of the camera from a centre at which all points are seen. */
  #fit(center: Point): number {
    const up = Math.tan((this.camera.fov * Math.PI) / 360);
    const across = up * this.camera.aspect;
    const [ca, sa, ce, se] = [
      Math.cos(this.#azimuth),
      Math.sin(this.#azimuth),
      Math.cos(this.#elevation),
      Math.sin(this.#elevation),
    ];
    return this.#points.reduce((most, p) => {
      const [x, y, z] = [p[0] - center[0], p[1] - center[1], p[2] - center[2]];
      const toward = x * ca * ce + y * sa * ce + z * se;
      const right = Math.abs(y * ca - x * sa);
      const height = Math.abs(z * ce - (x * ca + y * sa) * se);
      return Math.max(most, toward + MARGIN * Math.max(right / across, height / up));
    }, 0.3);
  }

  /** Also after the size of the canvas has changed. */
  #place(): void {
    const { distance } = this;
    const [x, y, z] = this.#center;
    const level = Math.cos(this.#elevation) * distance;
    this.camera.position.set(
      x + level * Math.cos(this.#azimuth),
      y + level * Math.sin(this.#azimuth),
      z + Math.sin(this.#elevation) * distance,
    );
    this.camera.lookAt(x, y, z);
    this.camera.near = distance / 100;
    this.camera.far = distance * 10;
    this.camera.updateProjectionMatrix();
    this.changed();
  }

  resized(): void {
    if (this.#touched || this.#points.length === 0) this.#place();
    else this.#refit();
  }

  #turn(right: number, up: number): void {
    this.#touched = true;
    this.#azimuth -= right;
    this.#elevation = Math.max(-1.5, Math.min(1.5, this.#elevation + up));
    this.#place();
  }

  #magnify(factor: number): void {
    this.#touched = true;
    this.#zoom = Math.max(0.3, Math.min(12, this.#zoom * factor));
    this.#place();
  }

  #drag(event: PointerEvent): void {
    const before = this.#pointers.get(event.pointerId);
    if (!before) return;
    const spread = this.#spread();
    this.#pointers.set(event.pointerId, [event.clientX, event.clientY]);
    if (this.#pointers.size === 1) this.#turn((event.clientX - before[0]) * TURN, (event.clientY - before[1]) * TURN);
    else if (spread > 0) this.#magnify(this.#spread() / spread);
  }

  #spread(): number {
    const [a, b] = [...this.#pointers.values()];
    return a && b ? Math.hypot(a[0] - b[0], a[1] - b[1]) : 0;
  }

  #wheel(event: WheelEvent): void {
    if (!event.ctrlKey && document.activeElement !== event.currentTarget) return; // the page scrolls on
    event.preventDefault();
    this.#magnify(event.deltaY < 0 ? ZOOM : 1 / ZOOM);
  }

  #key(event: KeyboardEvent): void {
    const steps: Record<string, () => void> = {
      ArrowLeft: () => this.#turn(-KEY_TURN, 0),
      ArrowRight: () => this.#turn(KEY_TURN, 0),
      ArrowUp: () => this.#turn(0, KEY_TURN),
      ArrowDown: () => this.#turn(0, -KEY_TURN),
      "+": () => this.#magnify(ZOOM),
      "=": () => this.#magnify(ZOOM),
      "-": () => this.#magnify(1 / ZOOM),
      "0": () => this.reset(),
    };
    const step = steps[event.key];
    if (!step) return;
    event.preventDefault();
    step();
  }
}
