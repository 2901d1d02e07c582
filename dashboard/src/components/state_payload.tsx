/** The payload of a robot, as a run asks for it: kept with the robot, and the readings are identified again. */
import { useState } from "preact/hooks";
import { api } from "../api/calls";
import type { AdvisedAction, Run } from "../api/types";
import { text } from "../i18n";
import type { Fields } from "../lib/json";
import { link, useAction } from "../state/action";
import { ActionButton } from "./basics";
import { SchemaFields } from "./schema_form";

export function StatePayload({ action, run }: { action: AdvisedAction; run: Run }) {
  const [stated, setStated] = useState<Fields>({});
  const payload = typeof stated["payload"] === "number" ? stated["payload"] : null;
  const state = useAction(async () => link(["runs", (await api.apply(run.id, { ...action, payload })).id]));
  return (
    <>
      <SchemaFields of="RobotChange" show={["payload"]} value={stated} change={setStated} />
      <ActionButton action={state} disabled={payload === null} going={text.start.going}>
        {text.assessment.actions.state_payload()}
      </ActionButton>
    </>
  );
}
