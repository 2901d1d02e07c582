/** All that a run can be told beside its readings, in one fold: its defaults are the best answer. */
import { type Dispatch, type StateUpdater, useContext, useEffect, useRef, useState } from "preact/hooks";
import type { Elasticity, Loss, Method, RunOptions, Weighting } from "../api/types";
import { Choice, Toggle } from "../components/basics";
import { FaultsAt, FormProblem, NumberField, Select } from "../components/fields";
import type { Facts } from "../lib/campaign";
import { entriesOf } from "../lib/json";
import { faultsAt } from "../lib/faults";
import { NOISE_AS_READ, type StatedNoise } from "../lib/noise";
import { hasLinks, initialOptions, lossesOf, type Options, optionsOf, requestOf } from "../lib/run_options";
import { formUnit } from "../lib/units";
import { useSettings } from "../state/settings";
import { text } from "../i18n";
import { JointKnowledge } from "./joint_knowledge";
import { NoiseForm } from "./noise_form";

const words = text.settings;

/** Numbers that are typed: field of the request, label, unit, help, and what holds where nothing is typed. */
const NUMBERS = {
  characteristicLength: ["characteristic_length", words.length, text.units.mm, words.lengthHelp, words.chosen],
  huberThreshold: ["huber_threshold", words.huber, text.glossary.sigma[0], words.huberHelp, "2.8"],
  linkPenalty: ["link_penalty", words.penalty, text.units.none, words.penaltyHelp, words.chosen],
  folds: ["cross_validation.folds", words.folds, undefined, words.foldsHelp, "5"],
  foldDraws: ["cross_validation.draws", words.foldDraws, undefined, words.foldDrawsHelp, "4"],
  foldSeed: ["cross_validation.seed", words.foldSeed, undefined, words.seedHelp, "0"],
  repetitions: ["resampling.repetitions", text.options.repetitions, undefined, undefined, "1000"],
  size: ["resampling.size", text.options.size, undefined, undefined, "10"],
  seed: ["resampling.seed", words.seed, undefined, words.seedHelp, "0"],
} as const;

/** Fields of a request that stand here: a fault in one of them opens the fold. */
export const SETTINGS_FIELDS = [
  ...Object.values(NUMBERS).map(([path]) => path),
  ...["method", "weighting", "loss", "elasticity", "stiffness_bounds", "priors", "stiffness_order", "links", "noise"],
];

interface RunForm {
  options: Options;
  setOptions: Dispatch<StateUpdater<Options>>;
  noise: StatedNoise;
  setNoise: Dispatch<StateUpdater<StatedNoise>>;
  /** Take the options of a campaign file. */
  take: (run: Partial<RunOptions>) => void;
  request: (set: string) => Record<string, unknown>;
}

export function useRunForm(): RunForm {
  const [options, setOptions] = useState<Options>(initialOptions);
  const [noise, setNoise] = useState<StatedNoise>(NOISE_AS_READ);
  const stiffness = 1 / formUnit(useSettings().unit).factor;
  return {
    options,
    setOptions,
    noise,
    setNoise,
    take: (run) => setOptions(optionsOf(run, stiffness)),
    request: (set) => requestOf(set, options, stiffness),
  };
}

export function Advanced({
  form,
  facts,
  joints,
}: {
  form: RunForm;
  facts: Facts | null;
  /** Names of the robot's joints; empty while no robot is chosen. */
  joints: string[];
}) {
  const problem = useContext(FormProblem);
  const { options, setOptions, noise, setNoise } = form;
  const change = (part: Partial<Options>) => setOptions((before) => ({ ...before, ...part }));
  const [open, setOpen] = useState(false);
  const details = useRef<HTMLDetailsElement>(null);
  useEffect(() => {
    if (!SETTINGS_FIELDS.some((path) => faultsAt(problem, path).length > 0)) return;
    setOpen(true);
    setTimeout(() => details.current?.querySelector(".fault")?.scrollIntoView({ block: "center" }));
  }, [problem]);
  const number = (name: keyof typeof NUMBERS) => {
    const [path, label, unit, help, placeholder] = NUMBERS[name];
    const set = (typed: string) => change({ [name]: typed });
    return <NumberField {...{ label, unit, help, placeholder }} value={options[name]} change={set} path={path} />;
  };
  const few = facts !== null && facts.targets.length < 3;
  const elastic = options.elasticity !== "joints";
  return (
    <details
      class="card wide settings"
      ref={details}
      open={open}
      onToggle={(event) => setOpen(event.currentTarget.open)}
    >
      <summary>
        {words.title} <small class="soft">{changesIn(form.request("")) || words.defaults}</small>
      </summary>
      <fieldset>
        <legend>{words.fit}</legend>
        <div class="grid">
          <Select
            label={text.run.method}
            help={few ? text.methodLacks(facts.targets.length) : text.methodHints[options.method]}
            value={options.method}
            change={(method) => change({ method: method as Method })}
            options={entriesOf(text.methods).map(([value, label]) => ({
              value,
              label,
              disabled: few && value !== "partial_pose",
            }))}
            path="method"
          />
          <Select
            label={text.options.elasticity}
            help={text.options.elasticityHint}
            value={options.elasticity}
            change={(elasticity) => change({ elasticity: elasticity as Elasticity })}
            options={text.elasticities}
            path="elasticity"
          />
          <Select
            label={text.options.loss}
            help={text.options.lossHint}
            value={options.loss}
            change={(loss) => change({ loss: loss as Loss | "" })}
            options={[
              { value: "", label: text.options.lossDefault },
              ...entriesOf(text.losses)
                .filter(([value]) => lossesOf(options.elasticity).includes(value))
                .map(([value, label]) => ({ value, label })),
            ]}
            path="loss"
          />
          {options.loss === "huber" && number("huberThreshold")}
          <Select
            label={words.weighting}
            help={words.weightingHelp[options.weighting]}
            value={options.weighting}
            change={(weighting) => change({ weighting: weighting as Weighting })}
            options={text.weightings}
            path="weighting"
          />
          {options.weighting === "characteristic_length" && number("characteristicLength")}
          <Choice
            label={text.options.confidence}
            value={options.confidence}
            change={(confidence) => change({ confidence })}
            options={["0.9", "0.95", "0.99"].map((value) => ({ value, label: `${Math.round(Number(value) * 100)} %` }))}
          />
          {(["positive", "complementary", "ownWeight", "resample"] as const).map((name) => (
            <Toggle label={text.options[name]} checked={options[name]} change={(on) => change({ [name]: on })} />
          ))}
        </div>
      </fieldset>
      {options.resample && (
        <fieldset>
          <legend>{words.resampling}</legend>
          <div class="grid">
            {number("repetitions")}
            {number("size")}
            {number("seed")}
            <Toggle
              label={words.replacement}
              checked={options.replacement}
              change={(replacement) => change({ replacement })}
            />
          </div>
        </fieldset>
      )}
      {elastic && (
        <fieldset>
          <legend>{words.elastic}</legend>
          {hasLinks(options.elasticity) && <Links {...{ options, change, joints }} />}
          <div class="grid">
            {options.elasticity !== "automatic" && number("linkPenalty")}
            {number("folds")}
            {number("foldDraws")}
            {number("foldSeed")}
            <Choice label={words.rule} value={options.rule} change={(rule) => change({ rule })} options={words.rules} />
          </div>
        </fieldset>
      )}
      <JointKnowledge {...{ options, change, joints }} />
      <NoiseForm noise={noise} change={setNoise} />
    </details>
  );
}

export interface SettingsProps {
  options: Options;
  change: (part: Partial<Options>) => void;
  joints: string[];
}

function Links({ options, change, joints }: SettingsProps) {
  const toggled = (joint: string, on: boolean) =>
    change({ links: joints.filter((name) => (name === joint ? on : options.links.includes(name))) });
  return (
    <>
      <p class="soft">{words.linksHelp}</p>
      <div class="toggles">
        {joints.map((joint) => (
          <Toggle label={joint} checked={options.links.includes(joint)} change={(on) => toggled(joint, on)} />
        ))}
      </div>
      <FaultsAt path="links" />
    </>
  );
}

/** What differs from the defaults: single values as they are, of others their name. */
function changesIn({ measurement_set_id: _, ...request }: Record<string, unknown>): string {
  const said = Object.entries(request).map(([name, value]) => {
    const plain = name.replaceAll("_", " ");
    if (name === "characteristic_length") return `${plain}: ${1e3 * Number(value)} ${text.units.mm}`;
    return typeof value === "object" ? plain : `${plain}: ${String(value).replaceAll("_", " ")}`;
  });
  return said.join(", ");
}
