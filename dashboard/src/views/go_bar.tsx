/** The one button at the end of a flow, and why it cannot be pressed yet. */
import type { Problem } from "../api/types";
import { Button, ProblemNote } from "../components/basics";
import { elsewhere } from "../lib/faults";
import type { Action } from "../state/action";
import { text } from "../i18n";
import { SETTINGS_FIELDS } from "./advanced";

export function GoBar({ action, ready, why }: { action: Action<[]>; ready: boolean; why: string | null }) {
  return (
    <div class={ready ? "gobar wide ready" : "gobar wide"}>
      {action.problem && <GoProblem problem={action.problem} />}
      <div class="go">
        <Button look="primary big" disabled={!ready || action.busy} onClick={action.run}>
          {action.busy ? text.start.going : text.start.go}
        </Button>
        {!ready && why !== null && <span class="soft">{why}</span>}
      </div>
    </div>
  );
}

const GoProblem = ({ problem }: { problem: Problem }) => <ProblemNote problem={elsewhere(problem, SETTINGS_FIELDS)} />;
