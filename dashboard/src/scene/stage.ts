/**
 * The 3D view: one arm, its load, and arrows of deflection. Draws a frame when something has changed, and only
 * then; each frame's script time is a `performance` measure named FRAME.
 */
import {
  Color,
  DirectionalLight,
  GridHelper,
  HemisphereLight,
  type LineBasicMaterial,
  PerspectiveCamera,
  SRGBColorSpace,
  Scene,
  Vector3,
  WebGLRenderer,
} from "three";
import { bent, type Vector, norm, times } from "../lib/vector";
import { Arm, type Arrow, Arrows, Cloud, ScaleBar, type Label, Labels } from "./parts";
import type { Box } from "../lib/box";
import type { Pull } from "../lib/pull";
import type { HeldBox } from "./box";
import type { HeldForce } from "./pull";
import { Orbit } from "./orbit";
import type { Show } from "./show";

const FRAME = "jointstiff.frame";
const KEPT_FRAMES = 500;

/** Seconds: down, held, and up again. */
const BEND = { down: 0.8, held: 0.7, up: 0.6 };

export class Stage {
  readonly #renderer: WebGLRenderer;
  readonly #scene = new Scene();
  readonly #camera = new PerspectiveCamera(36, 1);
  readonly #orbit: Orbit;
  readonly #arm = new Arm();
  readonly #measured = new Arrows();
  readonly #predicted = new Arrows();
  readonly #load = new Arrows();
  readonly #cloud = new Cloud();
  readonly #triad = new Arrows();
  readonly #parts = [this.#arm, this.#measured, this.#predicted, this.#load, this.#cloud, this.#triad];
  readonly #labels: Labels;
  readonly #bar: ScaleBar;
  #ramp: Ramp = [new Color(), new Color(), new Color()];
  #axisColors: Color[] = [];
  #mapRamp: Ramp = [new Color(), new Color(), new Color()];
  #bendStart: number | null = null;
  readonly #observer: ResizeObserver;
  readonly #dark = matchMedia("(prefers-color-scheme: dark)");
  #grid: GridHelper | null = null;
  #reach = 1;
  #show: Show | null = null;
  #shown: Show | null = null;
  #waiting = 0;
  #frames = 0;
  /** Of what is shown, its box; undefined until one is shown. */
  #box: Promise<HeldBox> | undefined;
  #boxDrawn: HeldBox | null = null;
  /** The same of a force that is pulled. */
  #force: Promise<HeldForce> | undefined;
  #forceDrawn: HeldForce | null = null;
  #gone = false;

  /** Has no box of its own: what is in it is placed in the view. */
  readonly #element = document.createElement("div");
  readonly canvas = document.createElement("canvas");
  #hears: Hears = SILENT;

  /** Throws where the device has no WebGL. */
  constructor(view: HTMLElement) {
    this.#element.className = "held";
    this.#element.append(this.canvas);
    view.append(this.#element);
    const { canvas } = this;
    canvas.tabIndex = 0;
    canvas.dataset["ready"] = "false";
    this.#renderer = new WebGLRenderer({
      canvas,
      antialias: true,
      powerPreference: "low-power",
      preserveDrawingBuffer: true, // else paper stays blank
    });
    this.#renderer.outputColorSpace = SRGBColorSpace;
    this.#renderer.setPixelRatio(Math.min(2, devicePixelRatio));
    this.#camera.up.set(0, 0, 1);
    const sun = new DirectionalLight(0xffffff, 1.6);
    sun.position.copy(new Vector3(2, -3, 5));
    this.#scene.add(new HemisphereLight(0xffffff, 0x8a938f, 1.9), sun, ...this.#parts);
    this.#labels = new Labels(canvas);
    this.#scene.add(this.#labels);
    this.#bar = new ScaleBar(canvas);
    this.#orbit = new Orbit(this.#camera, canvas, () => this.request());
    this.#observer = new ResizeObserver(() => this.#resize());
    this.#observer.observe(canvas);
    addEventListener("themechange", this.#paint);
    this.#dark.addEventListener("change", this.#paint);
    this.#paint();
  }

  /** Go into a view; from a view of something else, the first look is new, and nothing is seen before it. */
  enter(view: HTMLElement, isNew: boolean): void {
    view.append(this.#element);
    if (isNew) {
      this.#orbit.forget();
      this.#show = null;
      this.canvas.dataset["ready"] = "false";
      this.#element.hidden = true;
    }
    this.#paint();
  }

  /** Leave a view, with the last picture. */
  leave(): void {
    this.#hears = SILENT;
    this.#bendStart = null;
    this.#element.remove();
  }

  /** Say what the hand does to `hears`; `label` is for those who do not see the picture. */
  listen(label: string, hears: Hears): void {
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", label);
    this.#hears = hears;
  }

  /** Hold these points in view; `reach` is the size of the arm [m]. */
  room(points: Vector[], near = false): void {
    const reach = Math.max(0.2, ...points.map(norm));
    if (Math.abs(reach / this.#reach - 1) > 0.35) {
      this.#reach = reach;
      this.#floor();
      this.#shown = null;
    }
    const foot = this.#reach * 0.16;
    this.#orbit.frame(near ? points : [...points, [foot, foot, 0], [-foot, -foot, 0]]);
    this.request();
  }

  show(show: Show): void {
    this.#show = show;
    this.#element.hidden = false;
    this.canvas.dataset["ready"] = "true";
    this.request();
  }

  reset(): void {
    this.#orbit.reset();
  }

  /** Let the arm give way under its load and come back; without motion for those who want none. */
  bend(): void {
    this.#bendStart = performance.now();
    this.request();
  }

  /** Draw a frame soon, once however often it is asked. */
  request(): void {
    if (this.#waiting === 0) this.#waiting = requestAnimationFrame(this.#draw);
  }

  dispose(): void {
    this.#gone = true;
    this.#boxDrawn?.dispose();
    this.#forceDrawn?.dispose();
    cancelAnimationFrame(this.#waiting);
    this.#observer.disconnect();
    removeEventListener("themechange", this.#paint);
    this.#dark.removeEventListener("change", this.#paint);
    for (const part of this.#parts) part.dispose();
    this.#orbit.dispose();
    this.#labels.dispose();
    this.#bar.dispose();
    this.#grid?.dispose();
    this.#renderer.dispose();
    this.#renderer.forceContextLoss(); // browsers keep few contexts, and drop them late
    this.#element.remove();
  }

  readonly #draw = (): void => {
    const start = performance.now();
    this.#waiting = 0;
    if (this.#show && this.#show !== this.#shown) this.#apply(this.#show);
    this.#bendNow(start);
    this.#boxDrawn?.sized(this.#camera, this.#pixel);
    this.#forceDrawn?.sized(this.#camera, this.#pixel);
    this.#renderer.render(this.#scene, this.#camera);
    this.#labels.render(this.#scene, this.#camera);
    this.#bar.set(1 / (this.#pixel * this.#orbit.distance), this.#show?.factor ?? 1);
    performance.measure(FRAME, { start, end: performance.now() });
    if (++this.#frames % KEPT_FRAMES === 0) performance.clearMeasures(FRAME);
  };

  /** Size of a pixel at a distance of 1. */
  get #pixel(): number {
    return (2 * Math.tan((this.#camera.fov * Math.PI) / 360)) / (this.canvas.clientHeight || 1);
  }

  /** One step of the bend; asks for the next until it is over. */
  #bendNow(now: number): void {
    if (this.#bendStart === null || !this.#show) return;
    const time = (now - this.#bendStart) / 1e3;
    const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
    const over = time > BEND.down + BEND.held + BEND.up;
    const part = over ? 0 : still ? 1 : bendPart(time);
    const { posture, bend, factor } = this.#show;
    const angles = bend.map((angle) => angle * factor * part);
    this.#arm.set(part > 0 ? bent(posture, angles) : posture, this.#reach);
    if (over) this.#bendStart = null;
    else this.request();
  }

  #apply(show: Show): void {
    this.#shown = show;
    this.#arm.paintJoints(show.shares.map((share) => (share === null ? null : rampAt(this.#mapRamp, share))));
    this.#arm.choose(show.chosen);
    this.#arm.set(show.posture, this.#reach);
    this.#arm.axes.visible = show.axes;
    const thin = this.#reach * (show.measured.length > 40 ? 0.003 : 0.006);
    const worst = show.byResidual;
    const ramp = worst === null ? null : show.residuals.map((value) => rampAt(this.#ramp, value / worst));
    this.#measured.material.transparent = ramp === null;
    this.#measured.material.opacity = ramp === null ? 0.45 : 1;
    this.#measured.material.depthWrite = ramp !== null;
    this.#measured.paint(ramp === null ? this.#color("--measured") : new Color(1, 1, 1), ramp !== null);
    this.#measured.set(show.measured, show.factor, thin * (ramp === null ? 2.4 : 1.5), ramp);
    this.#predicted.set(ramp === null ? show.predicted : [], show.factor, thin); // shows inside the measured one
    this.#load.set(loadArrows(show, this.#reach), 1, this.#reach * 0.008);
    const axes = AXES.map(({ along }) => ({ from: [0, 0, 0], along: times(along, this.#reach * 0.26) }) as const);
    this.#triad.set(axes, 1, this.#reach * 0.006, this.#axisColors);
    const { places = [], shares = [], size = 0 } = show.cloud ?? {};
    const colors = shares.map((share) => rampAt(this.#mapRamp, share));
    this.#cloud.set(places, colors, size, this.#camera.fov);
    this.#labels.set(labelsOf(show, this.#reach));
    if (show.box || this.#boxDrawn) void this.#hold(show.box);
    if (show.pull || this.#forceDrawn) void this.#holdForce(show.pull);
  }

  /** Show a box, or none; its code comes with the first one. */
  async #hold(box: Box | undefined): Promise<void> {
    this.#box ??= import("./box").then(
      ({ HeldBox: Make }) => new Make(this.#camera, this.canvas, (held) => this.#orbit.pause(held), this.#moved),
    );
    let drawn: HeldBox;
    try {
      drawn = await this.#box;
    } catch {
      this.#box = undefined; // offline, or of another release: the next picture tries again
      return;
    }
    if (this.#gone) return drawn.dispose();
    if (this.#boxDrawn === null) {
      this.#boxDrawn = drawn;
      this.#scene.add(drawn);
      drawn.paint(this.#color("--accent"), this.#axisColors);
    }
    drawn.visible = box !== undefined;
    if (box) drawn.set(box);
    this.request();
  }

  /** Show the head of a force, or none; its code comes with the first one. */
  async #holdForce(pull: Pull | undefined): Promise<void> {
    this.#force ??= import("./pull").then(
      ({ HeldForce: Make }) => new Make(this.#camera, this.canvas, (held) => this.#orbit.pause(held), this.#pulledTo),
    );
    let drawn: HeldForce;
    try {
      drawn = await this.#force;
    } catch {
      this.#force = undefined; // offline, or of another release: the next picture tries again
      return;
    }
    if (this.#gone) return drawn.dispose();
    if (this.#forceDrawn === null) {
      this.#forceDrawn = drawn;
      this.#scene.add(drawn);
      drawn.paint(this.#color("--load"));
    }
    drawn.visible = pull !== undefined;
    if (pull) drawn.set(pull);
    this.request();
  }

  readonly #pulledTo = (force: Vector): void => {
    this.request();
    this.#hears.pulled(force);
  };

  readonly #moved = (box: Box): void => {
    this.request();
    this.#hears.dragged(box);
  };

  /** A colour of the style sheet as the browser resolves it for the theme. */
  #color(name: string): Color {
    const probe = document.createElement("i");
    probe.style.color = `var(${name})`;
    this.canvas.parentElement?.append(probe);
    const { color } = getComputedStyle(probe);
    probe.remove();
    return new Color().setStyle(color, SRGBColorSpace);
  }

  readonly #paint = (): void => {
    if (!this.#element.isConnected) return; // without the style sheet there are no colours
    const color = (name: string) => this.#color(name);
    this.#scene.background = color("--stage");
    this.#arm.linkMaterial.color = color("--arm");
    this.#arm.jointMaterial.color = color("--arm-joint");
    this.#arm.axisMaterial.color = color("--axis");
    this.#arm.chosenMaterial.color = color("--accent");
    this.#arm.baseMaterial.color = color("--arm-joint");
    this.#axisColors = AXES.map(({ kind }) => color(`--${kind}`));
    this.#triad.paint(new Color(1, 1, 1), true);
    this.#ramp = [color("--good"), color("--warn"), color("--bad")];
    this.#mapRamp = [color("--ramp-0"), color("--ramp-1"), color("--ramp-2")];
    this.#shown = null;
    this.#predicted.paint(color("--predicted"));
    this.#load.paint(color("--load"));
    this.#boxDrawn?.paint(color("--accent"), this.#axisColors);
    this.#forceDrawn?.paint(color("--load"));
    this.#floor();
    this.request();
  };

  #floor(): void {
    if (this.#grid) {
      this.#scene.remove(this.#grid);
      this.#grid.dispose();
    }
    const line = this.#color("--stage-line");
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
    this.#labels.resized(width, height);
    this.#camera.aspect = width / height;
    this.#orbit.resized();
    cancelAnimationFrame(this.#waiting);
    this.#draw(); // at once: another size empties the picture
  }
}

/** What a hand does to the picture. */
export interface Hears {
  /** The box was dragged. */
  dragged: (box: Box) => void;
  /** The force was pulled [N]. */
  pulled: (force: Vector) => void;
}

const SILENT: Hears = { dragged: () => undefined, pulled: () => undefined };

type Ramp = [Color, Color, Color];

/** The colour at a share of a ramp, from its first over its second to its third. */
function rampAt([low, middle, high]: Ramp, share: number): Color {
  return share < 0.5 ? low.clone().lerp(middle, share * 2) : middle.clone().lerp(high, Math.min(1, share * 2 - 1));
}

/** Share of the whole bend after some seconds, eased at both ends. */
function bendPart(time: number): number {
  const ease = (x: number) => (1 - Math.cos(Math.PI * Math.min(1, Math.max(0, x)))) / 2;
  return time < BEND.down + BEND.held ? ease(time / BEND.down) : 1 - ease((time - BEND.down - BEND.held) / BEND.up);
}

const AXES = [
  { kind: "x", along: [1, 0, 0] },
  { kind: "y", along: [0, 1, 0] },
  { kind: "z", along: [0, 0, 1] },
] as const;

function labelsOf(show: Show, reach: number): Label[] {
  const axes = AXES.map(({ kind, along }): Label => ({ name: kind, kind, at: times(along, reach * 0.3) }));
  if (show.names.length === 0) return axes;
  const kindOf = (j: number) => (j === show.chosen ? "chosen" : "joint");
  const joints = show.posture.joint_origins.map((at, j): Label => ({ name: show.names[j] ?? "", kind: kindOf(j), at }));
  joints.sort((one, other) => Number(other.kind === "chosen") - Number(one.kind === "chosen")); // it takes its place first
  const targets = show.targets.map(
    (name, i): Label => ({ name, kind: "target", at: show.measured[i]?.from ?? [0, 0, 0] }),
  );
  return [...axes, ...joints, ...targets].filter(({ name }) => name !== "");
}

/** A force that is pulled is as long as it is large. */
function loadArrows({ load, pull }: Show, reach: number): Arrow[] {
  if (pull) return [{ from: pull.from, along: times(pull.force, pull.scale) }];
  return load ? [loadArrow(load, reach)] : [];
}

/** Of one length whatever the load: it shows where and which way. */
function loadArrow(load: Arrow, reach: number): Arrow {
  return { from: load.from, along: times(load.along, (reach * 0.3) / (norm(load.along) || 1)) };
}
