/** Views whose code is loaded when they are first shown, so that a result opens without it. */
import type { ComponentType } from "preact";
import { useEffect, useState } from "preact/hooks";
import { Busy } from "./basics";

/** A view in a module of its own. Code that cannot be loaded is an error of the view, as any other. */
export function lazy<Props extends object>(load: () => Promise<ComponentType<Props>>): ComponentType<Props> {
  let loaded: ComponentType<Props> | null = null;
  return function Lazy(props: Props) {
    const [View, setView] = useState<ComponentType<Props> | null>(() => loaded);
    const [failed, setFailed] = useState<unknown>(null);
    useEffect(() => {
      if (loaded) return;
      load().then((view) => {
        loaded = view;
        setView(() => view);
      }, setFailed);
    }, []);
    if (failed !== null) throw failed;
    return View ? <View {...props} /> : <Busy />;
  };
}
