/**
 * The 3D view: one arm, its load, and arrows of deflection. Draws a frame when something has changed, and only
 * then; each frame's script time is a `performance` measure named FRAME.
 */
import {
  Color,
  DirectionalLight,
  GridHelper,
  HemisphereLight,
  LineBasicMaterial,
  PerspectiveCamera,
  Scene,
  SRGBColorSpace,
  Vector3,
  WebGLRenderer,
} from "three";
import type { Posture } from "../api/types";
import { norm, type Vector } from "../pure/vector";
import { Arm } from "./arm";
import { Arrows, type Arrow } from "./arrows";
import { Orbit } from "./orbit";

export const FRAME = "jointstiff.frame";
const KEPT_FRAMES = 500;

/** What is shown. Lengths in m, R0. */
export interface Show {
  posture: Posture;
  measured: Arrow[];
  predicted: Arrow[];
  load: Arrow | null;
  /** By how much deflections are exaggerated. */
  factor: number;
  axes: boolean;
}

export class Stage {
  readonly #renderer: WebGLRenderer;
  readonly #scene = new Scene();
  readonly #camera = new PerspectiveCamera(36, 1);
  readonly #orbit: Orbit;
  readonly #arm = new Arm();
  readonly #measured = new Arrows();
  readonly #predicted = new Arrows();
  readonly #load = new Arrows();
  readonly #observer: ResizeObserver;
  #grid: GridHelper | null = null;
  #reach = 1;
  #show: Show | null = null;
  #shown: Show | null = null;
  #waiting = 0;
  #frames = 0;

  /** Throws where the device has no WebGL. */
  constructor(readonly canvas: HTMLCanvasElement) {
    this.#renderer = new WebGLRenderer({ canvas, antialias: true, powerPreference: "low-power" });
    this.#renderer.outputColorSpace = SRGBColorSpace;
    this.#renderer.setPixelRatio(Math.min(2, devicePixelRatio));
    this.#camera.up.set(0, 0, 1);
    const sun = new DirectionalLight(0xffffff, 1.6);
    sun.position.copy(new Vector3(2, -3, 5));
    this.#scene.add(new HemisphereLight(0xffffff, 0x8a938f, 1.9), sun, this.#arm.group);
    this.#scene.add(this.#measured.group, this.#predicted.group, this.#load.group);
    this.#orbit = new Orbit(this.#camera, canvas, () => this.request());
    this.#observer = new ResizeObserver(() => this.#resize());
    this.#observer.observe(canvas);
    addEventListener("themechange", this.#paint);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", this.#paint);
    this.#measured.material.transparent = true;
    this.#measured.material.opacity = 0.42;
    this.#measured.material.depthWrite = false;
    this.#paint();
  }

  /** Set the room: the camera and the floor fit all of these points. */
  room(points: Vector[]): void {
    const low: [number, number, number] = [-0.2, -0.2, 0];
    const high: [number, number, number] = [0.2, 0.2, 0.2];
    for (const point of points) {
      for (const i of [0, 1, 2] as const) {
        low[i] = Math.min(low[i], point[i]);
        high[i] = Math.max(high[i], point[i]);
      }
    }
    const center: [number, number, number] = [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, (low[2] + high[2]) / 2];
    this.#reach = Math.max(0.2, ...points.map(norm));
    this.#floor();
    this.#orbit.frame(center, Math.hypot(high[0] - low[0], high[1] - low[1], high[2] - low[2]) * 0.37);
  }

  show(show: Show): void {
    this.#show = show;
    this.request();
  }

  reset(): void {
    this.#orbit.reset();
  }

  /** Draw a frame soon, once however often it is asked. */
  request(): void {
    if (this.#waiting === 0) this.#waiting = requestAnimationFrame(this.#draw);
  }

  dispose(): void {
    cancelAnimationFrame(this.#waiting);
    this.#observer.disconnect();
    removeEventListener("themechange", this.#paint);
    matchMedia("(prefers-color-scheme: dark)").removeEventListener("change", this.#paint);
    for (const part of [this.#arm, this.#measured, this.#predicted, this.#load]) part.dispose();
    this.#renderer.dispose();
  }

  readonly #draw = (): void => {
    const start = performance.now();
    this.#waiting = 0;
    if (this.#show && this.#show !== this.#shown) this.#apply(this.#show);
    this.#renderer.render(this.#scene, this.#camera);
    performance.measure(FRAME, { start, end: performance.now() });
    if (++this.#frames % KEPT_FRAMES === 0) performance.clearMeasures(FRAME);
  };

  #apply(show: Show): void {
    const before = this.#shown;
    this.#shown = show;
    this.#arm.set(show.posture, this.#reach);
    this.#arm.axes.visible = show.axes;
    const thin = this.#reach * (show.measured.length > 40 ? 0.003 : 0.007);
    if (before?.measured !== show.measured || before.factor !== show.factor)
      this.#measured.set(show.measured, show.factor, thin * 2.4); // the predicted one shows inside it
    if (before?.predicted !== show.predicted || before.factor !== show.factor)
      this.#predicted.set(show.predicted, show.factor, thin);
    this.#load.set(show.load ? [loadArrow(show.load, this.#reach)] : [], 1, this.#reach * 0.009);
  }

  readonly #paint = (): void => {
    const color = (name: string) => new Color().setStyle(resolved(this.canvas, name), SRGBColorSpace);
    this.#scene.background = color("--stage");
    this.#arm.linkMaterial.color = color("--arm");
    this.#arm.jointMaterial.color = color("--arm-joint");
    this.#arm.axisMaterial.color = color("--axis");
    this.#measured.paint(color("--measured"));
    this.#predicted.paint(color("--predicted"));
    this.#load.paint(color("--load"));
    this.#floor();
    this.request();
  };

  #floor(): void {
    if (this.#grid) {
      this.#scene.remove(this.#grid);
      this.#grid.dispose();
    }
    const line = new Color().setStyle(resolved(this.canvas, "--stage-line"), SRGBColorSpace);
    const size = Math.ceil(this.#reach * 2.6);
    this.#grid = new GridHelper(size, size * 2, line, line);
    (this.#grid.material as LineBasicMaterial).vertexColors = true;
    this.#grid.rotation.x = Math.PI / 2;
    this.#scene.add(this.#grid);
  }

  #resize(): void {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (width === 0 || height === 0) return;
    this.#renderer.setSize(width, height, false);
    this.#camera.aspect = width / height;
    this.#orbit.resized();
  }
}

/** Of one length whatever the load: it shows where and which way. */
function loadArrow(load: Arrow, reach: number): Arrow {
  const factor = (reach * 0.3) / (norm(load.along) || 1);
  return { from: load.from, along: [load.along[0] * factor, load.along[1] * factor, load.along[2] * factor] };
}

/** A colour of the style sheet as the browser resolves it for the theme. */
function resolved(near: Element, name: string): string {
  const probe = document.createElement("i");
  probe.style.color = `var(${name})`;
  near.parentElement?.append(probe);
  const color = getComputedStyle(probe).color;
  probe.remove();
  return color;
}
