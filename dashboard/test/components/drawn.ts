/** Components drawn into a document without a browser. */
import { type ComponentChild, render } from "preact";
import { act } from "preact/test-utils";
import { afterEach } from "vitest";

let box: HTMLElement | null = null;

afterEach(() => {
  if (box) render(null, box);
  box?.remove();
  box = null;
});

/** Draw, and let effects and promises that are settled already take effect. */
export async function drawn(what: ComponentChild): Promise<HTMLElement> {
  box = document.body.appendChild(document.createElement("div"));
  const root = box;
  await act(async () => render(what, root));
  return root;
}

export async function press(root: HTMLElement, label: string): Promise<void> {
  const found = [...root.querySelectorAll("button")].find((button) => button.textContent === label);
  if (!found) throw new Error(`no button ${label} in ${root.innerHTML}`);
  await act(async () => found.click());
}

/** Do it, and wait for what it brings about: effects, then the answers they ask for. */
export async function settled(change: () => void): Promise<void> {
  await act(async () => change());
  await act(() => new Promise((done) => setTimeout(done)));
}
