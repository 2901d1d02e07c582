/** How to identify: the method in words, and the rest folded away. */
import type { Elasticity, Loss, Method, Problem } from "../api/types";
import { Choice, Select, Toggle } from "../components/basics";
import { Faults, TextField } from "../components/fields";
import type { Facts } from "../lib/campaign";
import { entriesOf } from "../lib/entries";
import { faultsAt } from "../lib/faults";
import { lossesOf, type Options } from "../lib/run_options";
import { text } from "../i18n";

const METHODS: Method[] = ["partial_pose", "decoupled_partial_pose", "complete_pose"];

export function MethodForm({
  options,
  change,
  facts,
  problem,
}: {
  options: Options;
  change: (options: Options) => void;
  facts: Facts | null;
  problem: Problem | null;
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
      <Faults faults={faultsAt(problem, "method")} />
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
            change={(elasticity) => set({ elasticity: elasticity as Elasticity })}
            options={entriesOf(text.elasticities).map(([value, label]) => ({ value, label }))}
          />
          <Select
            label={text.options.loss}
            hint={text.options.lossHint}
            value={options.loss}
            change={(loss) => set({ loss: loss as Loss | "" })}
            options={[
              { value: "", label: text.options.lossDefault },
              ...entriesOf(text.losses)
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
    <TextField
      label={label}
      type="number"
      inputMode="numeric"
      min={1}
      max={most}
      value={String(value)}
      change={(typed) => take(Number(typed))}
    />
  );
}
