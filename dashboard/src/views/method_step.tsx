/** The last step of a flow: the method, and all else that a run can be told. */
import { type Dispatch, type StateUpdater, useState } from "preact/hooks";
import type { Problem } from "../api/types";
import type { Facts } from "../lib/campaign";
import { NOISE_AS_READ, type StatedNoise } from "../lib/noise";
import { initialOptions, type Options, requestOf } from "../lib/run_options";
import { formUnit } from "../lib/units";
import { useSettings } from "../state/settings";
import { text } from "../i18n";
import { MethodForm } from "./method_form";
import { MoreSettings } from "./more_settings";
import { NoiseForm } from "./noise_form";

export interface RunForm {
  options: Options;
  setOptions: Dispatch<StateUpdater<Options>>;
  noise: StatedNoise;
  setNoise: Dispatch<StateUpdater<StatedNoise>>;
  request: (set: string) => Record<string, unknown>;
}

export function useRunForm(): RunForm {
  const [options, setOptions] = useState<Options>(initialOptions);
  const [noise, setNoise] = useState<StatedNoise>(NOISE_AS_READ);
  const { factor } = formUnit(useSettings().unit);
  return { options, setOptions, noise, setNoise, request: (set) => requestOf(set, options, 1 / factor) };
}

export function MethodStep({
  step,
  form: { options, setOptions, noise, setNoise },
  facts,
  joints,
  problem,
}: {
  step: number;
  form: RunForm;
  facts: Facts | null;
  /** Names of the robot's joints; empty while no robot is chosen. */
  joints: string[];
  problem: Problem | null;
}) {
  return (
    <section class="card wide" aria-labelledby="step-method">
      <h2 id="step-method">
        <span class="step">{step}</span>
        {text.start.method}
      </h2>
      <MethodForm options={options} change={setOptions} facts={facts} problem={problem} />
      <MoreSettings
        options={options}
        change={(part) => setOptions((before) => ({ ...before, ...part }))}
        joints={joints}
        problem={problem}
      >
        <NoiseForm noise={noise} change={setNoise} problem={problem} />
      </MoreSettings>
    </section>
  );
}
