/** The payload of a robot, as a run asks for it: kept with the robot, and the readings are identified again. */
import { useState } from "preact/hooks";
import { api } from "../api/calls";
import type { AdvisedAction, Run } from "../api/types";
import { text } from "../words";
import { link, useAction } from "../state/action";
import { ActionButton } from "./basics";
import { TextField } from "./fields";

export function StatePayload({ action, run }: { action: AdvisedAction; run: Run }) {
  const [typed, setTyped] = useState("");
  const payload = Number(typed); // [kg]
  const state = useAction(async () => link(["runs", (await api.apply(run.id, { ...action, payload })).id]));
  return (
    <>
      <TextField label={text.assessment.payload} unit="kg" type="number" value={typed} change={setTyped} />
      <ActionButton action={state} disabled={!(payload > 0)} going={text.start.going}>
        {text.assessment.actions.state_payload()}
      </ActionButton>
    </>
  );
}
