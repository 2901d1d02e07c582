/** Orbiting a camera about a point: one finger or the mouse turns, two fingers or the wheel zoom, keys do both. */
import type { PerspectiveCamera } from "three";

const TURN = 0.008; // radians a pixel
const KEY_TURN = 0.12;
const ZOOM = 1.12;
const START = { azimuth: -0.9, elevation: 0.42 };

export class Orbit {
  #azimuth = START.azimuth;
  #elevation = START.elevation;
  #zoom = 1;
  #center: [number, number, number] = [0, 0, 0];
  #radius = 1;
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

  /** Look at a sphere that holds everything. */
  frame(center: [number, number, number], radius: number): void {
    [this.#center, this.#radius] = [center, radius];
    this.#place();
  }

  reset(): void {
    [this.#azimuth, this.#elevation, this.#zoom] = [START.azimuth, START.elevation, 1];
    this.#place();
  }

  /** Also after the size of the canvas has changed. */
  #place(): void {
    const half = (this.camera.fov * Math.PI) / 360;
    const narrow = Math.min(1, this.camera.aspect);
    const distance = this.#radius / (Math.sin(half) * narrow) / this.#zoom;
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
    this.#place();
  }

  #turn(right: number, up: number): void {
    this.#azimuth -= right;
    this.#elevation = Math.max(-1.5, Math.min(1.5, this.#elevation + up));
    this.#place();
  }

  #magnify(factor: number): void {
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
