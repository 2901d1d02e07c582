/** The width of an element, so that charts are drawn in real pixels and their text stays readable. */
import type { RefObject } from "preact";
import { useLayoutEffect, useRef, useState } from "preact/hooks";

export function useWidth<Box extends HTMLElement>(): [RefObject<Box | null>, number] {
  const element = useRef<Box | null>(null);
  const [width, set] = useState(0);
  useLayoutEffect(() => {
    const watched = element.current;
    if (!watched) return undefined;
    set(Math.floor(watched.clientWidth));
    const observer = new ResizeObserver(([entry]) => entry && set(Math.floor(entry.contentRect.width)));
    observer.observe(watched);
    return () => observer.disconnect();
  }, []);
  return [element, width];
}
