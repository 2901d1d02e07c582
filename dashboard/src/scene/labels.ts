/** Names in the scene, written above the picture so that they stay sharp and readable. */
import { type PerspectiveCamera, Vector3 } from "three";
import type { Vector } from "../lib/vector";

export interface Label {
  name: string;
  at: Vector;
  /** Class of the style sheet. */
  kind: "joint" | "target" | "x" | "y" | "z";
}

const [LEAST_GAP, LETTER, MOST_WIDE] = [17, 7, 110]; // px
/** To the right of the point, to its left, below, above: the first that is free is taken. */
const PLACES = [
  [1, 0],
  [-1, 0],
  [1, 18],
  [-1, 18],
  [1, -18],
  [-1, -18],
] as const;

export class Labels {
  readonly #box: HTMLElement;
  #labels: Label[] = [];
  readonly #point = new Vector3();

  constructor(beside: HTMLElement) {
    this.#box = document.createElement("div");
    this.#box.className = "scene-labels";
    this.#box.setAttribute("aria-hidden", "true");
    beside.parentElement?.append(this.#box);
  }

  set(labels: Label[]): void {
    this.#labels = labels;
    this.#box.replaceChildren(
      ...labels.map(({ name, kind }) => {
        const label = document.createElement("span");
        label.className = `label-${kind}`;
        label.textContent = name;
        return label;
      }),
    );
  }

  /** Put each beside its point; one that finds no free place is left out. */
  place(camera: PerspectiveCamera, width: number, height: number): void {
    const taken: [number, number, number][] = [];
    this.#labels.forEach(({ at, kind }, i) => {
      const label = this.#box.children[i] as HTMLElement;
      const { x, y, z } = this.#point.set(...at).project(camera);
      const [left, top] = [((x + 1) / 2) * width, ((1 - y) / 2) * height];
      const wide = Math.min(MOST_WIDE, 8 + (label.textContent?.length ?? 0) * LETTER);
      const most = Math.max(0, width - wide - 20); // the label and its gap stay in the window
      const free = PLACES.map(
        ([side, below]) => [Math.min(most, Math.max(0, left + (side < 0 ? -wide - 20 : 0))), top + below] as const,
      ).find(([u, v]) => !taken.some(([x1, y1, w]) => u < x1 + w && x1 < u + wide && Math.abs(v - y1) < LEAST_GAP));
      label.hidden = !free || z > 1 || left < 0 || left > width || top < 0 || top > height;
      if (label.hidden || !free) return;
      if (kind === "joint" || kind === "target") taken.push([free[0], free[1], wide]);
      label.style.transform = `translate(${Math.round(free[0])}px, ${Math.round(free[1])}px)`;
    });
  }

  dispose(): void {
    this.#box.remove();
  }
}
