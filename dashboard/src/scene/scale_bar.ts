/** The scale bar: a round length at the distance of the arm, and the deflection that is drawn as long. */
import { significant } from "../lib/format";
import { roundStep } from "../lib/scale";
import { text } from "../i18n";

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
