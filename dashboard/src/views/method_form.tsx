/** How to identify: the method in words, and the rest folded away. */
import type { Method } from "../api/types";
import { Choice, Select, Toggle } from "../components/basics";
import type { Facts } from "../lib/campaign";
import { text } from "../i18n";

export interface Options {
  method: Method;
  positive: boolean;
  loss: string;
  complementary: boolean;
  resample: boolean;
  repetitions: number;
  size: number;
  confidence: string;
  elasticity: string;
}

export const initialOptions: Options = {
  method: "partial_pose",
  positive: true,
  loss: "",
  complementary: false,
  resample: false,
  repetitions: 1000,
  size: 10,
  confidence: "0.95",
  elasticity: "joints",
};

const METHODS: Method[] = ["partial_pose", "decoupled_partial_pose", "complete_pose"];

/** The request of a run. */
export function requestOf(set: string, options: Options): Record<string, unknown> {
  return {
    measurement_set_id: set,
    method: options.method,
    positive: options.positive,
    loss: lossesOf(options.elasticity).includes(options.loss) ? options.loss : null,
    complementary_stiffness: options.complementary ? "included" : "neglected",
    confidence: Number(options.confidence),
    elasticity: options.elasticity,
    resampling: options.resample ? { size: options.size, repetitions: options.repetitions, seed: 1 } : null,
  };
}

/** Losses that go with an elasticity, besides the default. */
function lossesOf(elasticity: string): string[] {
  if (elasticity === "automatic") return [];
  return elasticity === "joints" ? ["squared", "huber"] : ["squared", "huber", "absolute"];
}

export function MethodForm({
  options,
  change,
  facts,
}: {
  options: Options;
  change: (options: Options) => void;
  facts: Facts | null;
}) {
  const set = (part: Partial<Options>) => change({ ...options, ...part });
  const few = facts !== null && facts.targets.length < 3;
  return (
    <>
      <Choice
        cards
        label={text.start.method}
        value={options.method}
        change={(method) => set({ method })}
        options={METHODS.map((value) => {
          const lacking = few && value !== "partial_pose";
          return {
            value,
            label: text.methods[value],
            disabled: lacking,
            hint: lacking ? text.methodLacks(facts.targets.length) : text.methodHints[value],
          };
        })}
      />
      <details class="options-more">
        <summary>{text.start.more}</summary>
        <div class="grid">
          <Toggle label={text.options.positive} checked={options.positive} change={(positive) => set({ positive })} />
          <Toggle
            label={text.options.complementary}
            checked={options.complementary}
            change={(complementary) => set({ complementary })}
          />
          <Toggle label={text.options.resample} checked={options.resample} change={(resample) => set({ resample })} />
          {options.resample && (
            <>
              <Count
                label={text.options.repetitions}
                value={options.repetitions}
                most={100_000}
                change={(repetitions) => set({ repetitions })}
              />
              <Count
                label={text.options.size}
                value={options.size}
                most={Math.max(1, facts?.observations ?? 10_000)}
                change={(size) => set({ size })}
              />
            </>
          )}
          <Select
            label={text.options.elasticity}
            hint={text.options.elasticityHint}
            value={options.elasticity}
            change={(elasticity) => set({ elasticity })}
            options={Object.entries(text.elasticities).map(([value, label]) => ({ value, label }))}
          />
          <Select
            label={text.options.loss}
            hint={text.options.lossHint}
            value={options.loss}
            change={(loss) => set({ loss })}
            options={[
              { value: "", label: text.options.lossDefault },
              ...Object.entries(text.losses)
                .filter(([value]) => lossesOf(options.elasticity).includes(value))
                .map(([value, label]) => ({ value, label })),
            ]}
          />
          <Choice
            label={text.options.confidence}
            value={options.confidence}
            change={(confidence) => set({ confidence })}
            options={["0.9", "0.95", "0.99"].map((value) => ({ value, label: `${Math.round(Number(value) * 100)} %` }))}
          />
        </div>
      </details>
    </>
  );
}

function Count({
  label,
  value,
  most,
  change,
}: {
  label: string;
  value: number;
  most: number;
  change: (value: number) => void;
}) {
  const take = (entered: number) => {
    if (Number.isInteger(entered) && entered >= 1 && entered <= most) change(entered);
  };
  return (
    <label class="field">
      <span>{label}</span>
      <input
        type="number"
        inputMode="numeric"
        min={1}
        max={most}
        value={value}
        onInput={(event) => take(Number(event.currentTarget.value))}
      />
    </label>
  );
}
