/** The drawing lasts: a view that goes leaves it to the next one, with its picture, so that layers change and the arm stays. */
import type { Stage } from "./stage";

/** How long a drawing that no view shows is kept [ms]: browsers keep few. */
const KEPT_MS = 5 * 60_000;

interface Left {
  stage: Stage;
  /** What the drawing showed, as `subject` says. */
  of: string;
  timer: ReturnType<typeof setTimeout>;
}

let left: Left | null = null;

/** What a page is about, such as one run: all layers of it show the same arm. */
export const subject = (): string => location.hash.split("?")[0]?.split("/").slice(0, 3).join("/") ?? "";

/** Leave a drawing to the next view. */
export function leave(stage: Stage, of: string): void {
  end();
  stage.leave();
  left = { stage, of, timer: setTimeout(end, KEPT_MS) };
}

/** Take the drawing that was left, if there is one. */
export function take(): Omit<Left, "timer"> | null {
  const taken = left;
  if (taken) clearTimeout(taken.timer);
  left = null;
  return taken;
}

function end(): void {
  take()?.stage.dispose();
}
