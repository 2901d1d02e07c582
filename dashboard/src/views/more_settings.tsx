/** The rest of what a run can be told, folded away: weighting, knowledge of joints, elastic links, resampling, noise. */
import type { ComponentChildren } from "preact";
import { useEffect, useRef, useState } from "preact/hooks";
import type { Problem, Weighting } from "../api/types";
import { Choice, Select, Toggle } from "../components/basics";
import { Faults, NumberField } from "../components/fields";
import { entriesOf } from "../lib/entries";
import { faultsAt } from "../lib/faults";
import { hasLinks, type Options } from "../lib/run_options";
import { text } from "../i18n";
import { JointKnowledge } from "./joint_knowledge";

const words = text.settings;

/** Fields of a request that stand here: a fault in one of them opens the settings. */
export const SETTINGS_FIELDS = [
  "weighting",
  "characteristic_length",
  "huber_threshold",
  "stiffness_bounds",
  "priors",
  "stiffness_order",
  "links",
  "link_penalty",
  "cross_validation",
  "resampling.seed",
  "noise",
];

export interface SettingsProps {
  options: Options;
  change: (part: Partial<Options>) => void;
  /** Names of the robot's joints; empty while no robot is chosen. */
  joints: string[];
  problem: Problem | null;
}

export function MoreSettings({ children, ...props }: SettingsProps & { children?: ComponentChildren }) {
  const { problem } = props;
  const [open, setOpen] = useState(false);
  const details = useRef<HTMLDetailsElement>(null);
  useEffect(() => {
    if (!SETTINGS_FIELDS.some((path) => faultsAt(problem, path).length > 0)) return;
    setOpen(true);
    setTimeout(() => details.current?.querySelector(".fault")?.scrollIntoView({ block: "center" }));
  }, [problem]);
  return (
    <details
      class="options-more settings"
      ref={details}
      open={open}
      onToggle={(event) => setOpen(event.currentTarget.open)}
    >
      <summary>{words.title}</summary>
      <WeightingFields {...props} />
      <JointKnowledge {...props} />
      {props.options.elasticity !== "joints" && <LinkFields {...props} />}
      {props.options.resample && <ResamplingFields {...props} />}
      {children}
    </details>
  );
}

function WeightingFields({ options, change, problem }: SettingsProps) {
  return (
    <fieldset>
      <legend>{words.fit}</legend>
      <div class="grid">
        <div>
          <Select
            label={words.weighting}
            hint={words.weightingHelp[options.weighting]}
            value={options.weighting}
            change={(weighting) => change({ weighting: weighting as Weighting })}
            options={entriesOf(text.weightings).map(([value, label]) => ({ value, label }))}
          />
          <Faults faults={faultsAt(problem, "weighting")} />
        </div>
        {options.weighting === "characteristic_length" && (
          <NumberField
            label={words.length}
            unit={text.units.mm}
            help={words.lengthHelp}
            placeholder={words.chosen}
            value={options.characteristicLength}
            change={(characteristicLength) => change({ characteristicLength })}
            faults={faultsAt(problem, "characteristic_length")}
          />
        )}
        {options.loss === "huber" && (
          <NumberField
            label={words.huber}
            unit={text.glossary.sigma[0]}
            help={words.huberHelp}
            placeholder="2.8"
            value={options.huberThreshold}
            change={(huberThreshold) => change({ huberThreshold })}
            faults={faultsAt(problem, "huber_threshold")}
          />
        )}
      </div>
    </fieldset>
  );
}

function LinkFields({ options, change, joints, problem }: SettingsProps) {
  const toggled = (joint: string, on: boolean) =>
    change({ links: joints.filter((name) => (name === joint ? on : options.links.includes(name))) });
  return (
    <fieldset>
      <legend>{words.elastic}</legend>
      {hasLinks(options.elasticity) && (
        <>
          <p class="soft">{words.linksHelp}</p>
          <div class="toggles">
            {joints.map((joint) => (
              <Toggle label={joint} checked={options.links.includes(joint)} change={(on) => toggled(joint, on)} />
            ))}
          </div>
          <Faults faults={faultsAt(problem, "links")} />
        </>
      )}
      <div class="grid">
        {options.elasticity !== "automatic" && (
          <NumberField
            label={words.penalty}
            unit={text.units.none}
            help={words.penaltyHelp}
            placeholder={words.chosen}
            value={options.linkPenalty}
            change={(linkPenalty) => change({ linkPenalty })}
            faults={faultsAt(problem, "link_penalty")}
          />
        )}
        <NumberField
          label={words.folds}
          help={words.foldsHelp}
          placeholder="5"
          value={options.folds}
          change={(folds) => change({ folds })}
          faults={faultsAt(problem, "cross_validation.folds")}
        />
        <NumberField
          label={words.foldSeed}
          help={words.seedHelp}
          placeholder="0"
          value={options.foldSeed}
          change={(foldSeed) => change({ foldSeed })}
          faults={faultsAt(problem, "cross_validation.seed")}
        />
        <Choice
          label={words.rule}
          value={options.rule}
          change={(rule) => change({ rule })}
          options={entriesOf(words.rules).map(([value, label]) => ({ value, label }))}
        />
      </div>
    </fieldset>
  );
}

function ResamplingFields({ options, change, problem }: SettingsProps) {
  return (
    <fieldset>
      <legend>{words.resampling}</legend>
      <div class="grid">
        <NumberField
          label={words.seed}
          help={words.seedHelp}
          value={options.seed}
          change={(seed) => change({ seed })}
          faults={faultsAt(problem, "resampling.seed")}
        />
        <Toggle
          label={words.replacement}
          checked={options.replacement}
          change={(replacement) => change({ replacement })}
        />
      </div>
    </fieldset>
  );
}
