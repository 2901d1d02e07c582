/** Noise of the readings and of the load, where it is to be other than what the readings say. */
import { NumberField, VectorField, Select } from "../components/fields";
import type { StatedNoise } from "../lib/noise";
import { text } from "../i18n";

const words = text.noise;
/** What may be stated whatever the tracker's noise comes from: field, unit, place in a set's noise. */
const COMMON = [
  ["forceScale", text.units.share, "force.scale"],
  ["forceDirection", "mrad", "force.direction"],
  ["loadPoint", text.units.mm, "load_point"],
  ["targetPlaces", text.units.mm, "target_places"],
  ["encoder", "µrad", "encoder_sigma"],
] as const;
const PER_METRE = `${text.units.micrometre}/${text.units.metre}`;

export function NoiseForm({ noise, change }: { noise: StatedNoise; change: (noise: StatedNoise) => void }) {
  const set = (part: Partial<StatedNoise>) => change({ ...noise, ...part });
  return (
    <fieldset>
      <legend>{words.title}</legend>
      <p class="soft">{words.help}</p>
      <Select
        label={words.tracker}
        value={noise.kind}
        change={(kind) => set({ kind: kind as StatedNoise["kind"] })}
        options={words.kinds}
      />
      <div class="grid">
        {noise.kind === "sigma" && (
          <NumberField
            label={words.sigma}
            unit={text.units.micrometre}
            help={text.glossary.sigma[1]}
            value={noise.sigma}
            change={(sigma) => set({ sigma })}
            path="noise.sigma"
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
              path="noise.instrument.station"
            />
            {(["range", "transverse"] as const).map((way) => (
              <>
                <NumberField
                  label={words.constant[way]}
                  unit={text.units.micrometre}
                  help={words.constantHelp}
                  value={noise[way][0]}
                  change={(typed) => set({ [way]: [typed, noise[way][1]] })}
                  path={`noise.instrument.${way}`}
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
        {COMMON.map(([name, unit, path]) => (
          <NumberField
            label={words[name]}
            unit={unit}
            help={words[`${name}Help`]}
            value={noise[name]}
            change={(typed) => set({ [name]: typed })}
            path={`noise.${path}`}
          />
        ))}
      </div>
    </fieldset>
  );
}
