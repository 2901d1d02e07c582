/** Views whose code is loaded when they are first shown, so that a result opens without it. */
import { Component, type ComponentChildren, type ComponentType } from "preact";
import { problemOf } from "../api/client";
import type { Problem } from "../api/types";
import { toast } from "../state/toasts";
import { Busy, Button, ProblemNote, Title } from "./basics";
import { useEffect, useState } from "preact/hooks";
import { text } from "../i18n";

/** A view in a module of its own. After an update of the service its file is another: the page has to be loaded again. */
export function lazy<Props extends object>(load: () => Promise<ComponentType<Props>>): ComponentType<Props> {
  let loaded: ComponentType<Props> | null = null;
  return function Lazy(props: Props) {
    const [View, setView] = useState<ComponentType<Props> | null>(() => loaded);
    const [failed, setFailed] = useState(false);
    useEffect(() => {
      if (loaded) return;
      load().then(
        (view) => {
          loaded = view;
          setView(() => view);
        },
        () => setFailed(true),
      );
    }, []);
    if (failed) return <Outdated />;
    return View ? <View {...props} /> : <Busy />;
  };
}

function Outdated() {
  const words = text.errors.outdated;
  return (
    <>
      <Title plain={words.title}>{words.title}</Title>
      <div class="note bad" role="alert">
        <p>{words.detail}</p>
        <Button look="primary" onClick={() => location.reload()}>
          {words.reload}
        </Button>
      </div>
    </>
  );
}

export class Boundary extends Component<{ children: ComponentChildren }, { problem: Problem | null }> {
  override state = { problem: null };

  static override getDerivedStateFromError(error: unknown): { problem: Problem } {
    return { problem: problemOf(error) };
  }

  override render() {
    const { problem } = this.state;
    return problem ? <ProblemNote problem={problem} /> : this.props.children;
  }
}

/** Show what fails where no view waits for it. */
export function reportStrays(): void {
  addEventListener("unhandledrejection", ({ reason }) => toast(problemOf(reason).detail));
}
