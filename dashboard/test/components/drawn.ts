/** Components drawn into a document without a browser. */
import { type ComponentChild, render } from "preact";
import { act } from "preact/test-utils";
import { afterEach, vi } from "vitest";
import { client } from "../../src/state/query";

let box: HTMLElement | null = null;

afterEach(() => {
  if (box) render(null, box);
  box?.remove();
  box = null;
  client.clear();
});

export interface Asked {
  method: string;
  /** Address with its query. */
  path: string;
  /** Options of a form, or what is posted as JSON; else null. */
  body: Record<string, unknown> | null;
}

/** Answer every request of the page by a message; an error that is thrown is one of the network. */
export function answering(answer: (asked: Asked) => unknown): void {
  vi.stubGlobal("fetch", async (request: Request) => {
    const { pathname, search } = new URL(request.url);
    const content = request.method === "GET" ? "" : await request.clone().text();
    const form = content && !content.startsWith("{") ? await request.formData() : null;
    const text = form ? String(form.get("options")) : content;
    const body = text ? (JSON.parse(text) as Record<string, unknown>) : null;
    const message = await answer({ method: request.method, path: pathname + search, body });
    return new Response(JSON.stringify(message), { headers: { "Content-Type": "application/json" } });
  });
}

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
  await settled(() => found.click());
}

/** Do it, and wait for what it brings about: effects, then the answers they ask for. */
export async function settled(change: () => void): Promise<void> {
  await act(async () => change());
  await act(() => new Promise((done) => setTimeout(done)));
}
