/** Noise of the readings and of the load, where it is to be other than what the readings say. */
import type { Problem } from "../api/types";
import { Select } from "../components/basics";
import { NumberField, VectorField } from "../components/fields";
import { entriesOf } from "../lib/entries";
import { faultsAt } from "../lib/faults";
import type { StatedNoise } from "../lib/noise";
import { text } from "../i18n";

const words = text.noise;
const PER_METRE = `${text.units.micrometre}/${text.units.metre}`;

export function NoiseForm({
  noise,
  change,
  problem,
}: {
  noise: StatedNoise;
  change: (noise: StatedNoise) => void;
  problem: Problem | null;
}) {
  const set = (part: Partial<StatedNoise>) => change({ ...noise, ...part });
  const at = (path: string) => faultsAt(problem, `noise.${path}`);
  return (
    <fieldset>
      <legend>{words.title}</legend>
      <p class="soft">{words.help}</p>
      <Select
        label={words.tracker}
        value={noise.kind}
        change={(kind) => set({ kind: kind as StatedNoise["kind"] })}
        options={entriesOf(words.kinds).map(([value, label]) => ({ value, label }))}
      />
      <div class="grid">
        {noise.kind === "sigma" && (
          <NumberField
            label={words.sigma}
            unit={text.units.micrometre}
            help={text.glossary.sigma[1]}
            value={noise.sigma}
            change={(sigma) => set({ sigma })}
            faults={at("sigma")}
          />
        )}
        {noise.kind === "instrument" && (
          <>
            <VectorField
              label={words.station}
              unit={text.units.mm}
              help={words.stationHelp}
              value={noise.station}
              change={(station) => set({ station })}
              faults={at("instrument.station")}
            />
            {(["range", "transverse"] as const).map((way) => (
              <>
                <NumberField
                  label={words.constant[way]}
                  unit={text.units.micrometre}
                  help={words.constantHelp}
                  value={noise[way][0]}
                  change={(typed) => set({ [way]: [typed, noise[way][1]] })}
                  faults={at(`instrument.${way}`)}
                />
                <NumberField
                  label={words.per[way]}
                  unit={PER_METRE}
                  help={words.perHelp}
                  value={noise[way][1]}
                  change={(typed) => set({ [way]: [noise[way][0], typed] })}
                />
              </>
            ))}
          </>
        )}
        <NumberField
          label={words.forceScale}
          unit={text.units.share}
          help={words.forceScaleHelp}
          value={noise.forceScale}
          change={(forceScale) => set({ forceScale })}
          faults={at("force.scale")}
        />
        <NumberField
          label={words.forceDirection}
          unit="mrad"
          help={words.forceDirectionHelp}
          value={noise.forceDirection}
          change={(forceDirection) => set({ forceDirection })}
          faults={at("force.direction")}
        />
        <NumberField
          label={words.loadPoint}
          unit={text.units.mm}
          help={words.loadPointHelp}
          value={noise.loadPoint}
          change={(loadPoint) => set({ loadPoint })}
          faults={at("load_point")}
        />
        <NumberField
          label={words.targetPlaces}
          unit={text.units.mm}
          help={words.targetPlacesHelp}
          value={noise.targetPlaces}
          change={(targetPlaces) => set({ targetPlaces })}
          faults={at("target_places")}
        />
        <NumberField
          label={words.encoder}
          unit="µrad"
          help={words.encoderHelp}
          value={noise.encoder}
          change={(encoder) => set({ encoder })}
          faults={at("encoder_sigma")}
        />
      </div>
    </fieldset>
  );
}
