/** What is stated of the errors of readings after the readings: stored with a set of its own, and identified again. */
import { api } from "../../api/calls";
import type { MeasurementSet } from "../../api/types";
import { ActionButton } from "../../components/basics";
import { RequestFields } from "../../components/fields";
import { SchemaFields, useDescribed } from "../../components/schema_form";
import { text } from "../../words";
import { noiseOf, type StatedNoise, statesNoise } from "../../lib/campaign";
import { contentKey, freshKey, unreadIn } from "../../lib/json";
import { link, useAction } from "../../state/action";
import { useTypedValue } from "../../state/session";
import { NOISE } from "../readings/flow";
import type { RunContext } from "../../state/run_context";

const words = text.assessment;

/** The set with another noise, stored as a set of its own. */
export async function withNoise(set: MeasurementSet, noise: StatedNoise): Promise<MeasurementSet> {
  const name = `${set.name} (${text.assessment.noiseStated})`;
  const { id, warnings, content_hash, created_at, resolved_frame, geometry_targets, open, live, ...posted } = set;
  const document = { ...posted, name, noise: noiseOf(noise, set.noise, set.units) };
  const added = await api.sets.add(document, contentKey("set", document));
  return added;
}

/** Fields that a run names when it assumed them. */
const ASSUMED = ["grounds", "load_point", "force", "target_places", "encoder_sigma"];

export function Assumed({ context: { run, set } }: { context: RunContext }) {
  const [noise, setNoise] = useTypedValue<StatedNoise>(`assumed/${run.id}`, {});
  const again = useAction(async () => {
    const stated = await withNoise(set, noise);
    const { variant_of: _, ...request } = run.request;
    const made = await api.runs.add({ ...request, measurement_set_id: stated.id }, freshKey("run"));
    return link(["runs", made.id]);
  });
  return (
    <RequestFields action={again} look="form" known={useDescribed()}>
      <p class="soft">{words.againHint}</p>
      <SchemaFields of="Noise" show={ASSUMED} value={noise} change={setNoise} terms={NOISE} />
      <ActionButton
        look="primary"
        action={again}
        going={text.start.going}
        disabled={!statesNoise(noise) || unreadIn(noise) !== null}
      >
        {words.again}
      </ActionButton>
    </RequestFields>
  );
}
