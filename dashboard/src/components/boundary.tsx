/** A view that fails while it is drawn says so, and the rest of the page goes on. */
import { Component, type ComponentChildren } from "preact";
import { problemOf } from "../api/client";
import type { Problem } from "../api/types";
import { toast } from "../state/toasts";
import { ProblemNote } from "./basics";

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
