/** Values under the pointer or the finger, for every mark of every chart that says `data-tip`. */
import { useEffect, useRef, useState } from "preact/hooks";
import { go } from "../state/router";
import { text } from "../i18n";

interface Shown {
  mark: Element;
  lines: string[];
  /** Address that the mark stands for. */
  open: string | null;
  /** A finger has no hover: what it touched offers its link. */
  touched: boolean;
}

const GAP = 14;

/** Attributes of a mark: a heading, values, and where a click on it leads. */
export function tip(lines: string[], open?: string | null): { "data-tip": string; "data-open"?: string } {
  return { "data-tip": lines.join("\n"), ...(open ? { "data-open": open } : {}) };
}

const markAt = (event: Event): Element | null =>
  event.target instanceof Element ? event.target.closest("[data-tip]") : null;

const shownOf = (mark: Element, touched: boolean): Shown => ({
  mark,
  lines: (mark.getAttribute("data-tip") ?? "").split("\n"),
  open: mark.getAttribute("data-open"),
  touched,
});

/** Stands once, at the end of the page. */
export function Tip() {
  const [shown, show] = useState<Shown | null>(null);
  const box = useRef<HTMLDivElement>(null);
  const at = useRef<[number, number]>([0, 0]);
  useEffect(() => {
    const move = (event: PointerEvent) => {
      if (event.pointerType === "touch") return;
      at.current = [event.clientX, event.clientY];
      const mark = markAt(event);
      show((before) => (before?.mark === mark ? before : mark && shownOf(mark, false)));
      place(box.current, at.current);
    };
    const press = (event: PointerEvent) => {
      if (event.pointerType !== "touch" || box.current?.contains(event.target as Node)) return;
      at.current = [event.clientX, event.clientY];
      const mark = markAt(event);
      show(mark && shownOf(mark, true));
    };
    const click = (event: MouseEvent) => {
      const open = markAt(event)?.getAttribute("data-open");
      if (open && (event as PointerEvent).pointerType !== "touch") go(open);
    };
    const hide = () => show(null);
    const focus = (event: FocusEvent) => {
      if (!(event.target instanceof Element && event.target.matches(":focus-visible"))) return; // a tap, not a key
      const mark = markAt(event);
      if (!mark) return hide();
      const { left, bottom } = mark.getBoundingClientRect();
      at.current = [left, bottom - GAP + 6];
      show(shownOf(mark, false));
    };
    const events = [
      ["pointermove", move],
      ["pointerdown", press],
      ["click", click],
      ["focusin", focus],
      ["hashchange", hide],
      ["scroll", hide],
    ] as const;
    for (const [name, hear] of events) addEventListener(name, hear as EventListener, { passive: true });
    return () => {
      for (const [name, hear] of events) removeEventListener(name, hear as EventListener);
    };
  }, []);
  useEffect(() => place(box.current, at.current), [shown]);
  if (!shown) return null;
  const [heading, ...values] = shown.lines;
  return (
    <div class={shown.touched ? "tip touched" : "tip"} ref={box} aria-hidden={!shown.touched}>
      <b>{heading}</b>
      {values.map((value) => (
        <span>{value}</span>
      ))}
      {shown.open &&
        (shown.touched ? <a href={shown.open}>{text.figure.open}</a> : <small>{text.figure.clickToOpen}</small>)}
    </div>
  );
}

/** Beside the pointer, inside the window. */
function place(box: HTMLElement | null, [x, y]: [number, number]): void {
  if (!box) return;
  const { offsetWidth: width, offsetHeight: height } = box;
  const left = x + GAP + width > innerWidth - 8 ? x - GAP - width : x + GAP;
  const top = y + GAP + height > innerHeight - 8 ? y - GAP - height : y + GAP;
  box.style.left = `${Math.max(8, left)}px`;
  box.style.top = `${Math.max(8, top)}px`;
}
