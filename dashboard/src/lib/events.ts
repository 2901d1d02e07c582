/** Events of the browser and of the page itself, such as that a key is needed: heard until one stops. */

/** What the page tells itself. */
export const news = new EventTarget();

export const tell = (name: string, detail?: unknown): void =>
  void news.dispatchEvent(new CustomEvent(name, { detail }));

/** Hear the events of a target; a key may be taken from the browser, a touch not. Answers with how to stop. */
export function listen(target: EventTarget, hears: Record<string, (event: never) => void>): () => void {
  const end = new AbortController();
  for (const [name, hear] of Object.entries(hears))
    target.addEventListener(name, hear as EventListener, { passive: name !== "keydown", signal: end.signal });
  return () => end.abort();
}
