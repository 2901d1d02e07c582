/** Whether the page is being printed: then a view shows all its parts, as a document. */
import { useEffect, useState } from "preact/hooks";

export function usePrinting(): boolean {
  const [printing, set] = useState(() => matchMedia("print").matches);
  useEffect(() => {
    const media = matchMedia("print");
    const change = () => set(media.matches);
    const [start, end] = [() => set(true), () => set(false)];
    media.addEventListener("change", change);
    addEventListener("beforeprint", start);
    addEventListener("afterprint", end);
    return () => {
      media.removeEventListener("change", change);
      removeEventListener("beforeprint", start);
      removeEventListener("afterprint", end);
    };
  }, []);
  return printing;
}
