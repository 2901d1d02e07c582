/** Noise of the readings and of the load, where it is to be other than what the readings say. */
import { FormFields, type FieldOf } from "../components/form";
import type { StatedNoise } from "../lib/noise";
import { text } from "../i18n";

const words = text.noise;
const { mm, micrometre, metre, share } = text.units;
const WAYS = ["range", "transverse"] as const;

/** What may be stated of the tracker, and whatever its noise comes from. */
const fieldsOf = (kind: StatedNoise["kind"]): FieldOf<StatedNoise>[] => [
  {
    name: "sigma",
    kind: "number",
    label: words.sigma,
    unit: micrometre,
    help: text.glossary.sigma[1],
    path: "noise.sigma",
    asked: kind === "sigma",
  },
  {
    name: "station",
    kind: "vector",
    label: words.station,
    unit: mm,
    help: words.stationHelp,
    path: "noise.instrument.station",
    asked: kind === "instrument",
  },
  ...WAYS.flatMap((way): FieldOf<StatedNoise>[] => [
    {
      name: way,
      kind: "number",
      label: words.constant[way],
      unit: micrometre,
      help: words.constantHelp,
      path: `noise.instrument.${way}`,
      asked: kind === "instrument",
    },
    {
      name: `${way}Per`,
      kind: "number",
      label: words.per[way],
      unit: `${micrometre}/${metre}`,
      help: words.perHelp,
      asked: kind === "instrument",
    },
  ]),
  ...(
    [
      ["forceScale", share, "force.scale"],
      ["forceDirection", "mrad", "force.direction"],
      ["loadPoint", mm, "load_point"],
      ["targetPlaces", mm, "target_places"],
      ["encoder", "µrad", "encoder_sigma"],
    ] as const
  ).map(
    ([name, unit, path]): FieldOf<StatedNoise> => ({
      name,
      kind: "number",
      label: words[name],
      unit,
      help: words[`${name}Help`],
      path: `noise.${path}`,
    }),
  ),
];

export function NoiseForm({ noise, change }: { noise: StatedNoise; change: (noise: StatedNoise) => void }) {
  const form = { values: noise, change: (part: Partial<StatedNoise>) => change({ ...noise, ...part }) };
  return (
    <fieldset>
      <legend>{words.title}</legend>
      <p class="soft">{words.help}</p>
      <FormFields {...form} fields={[{ name: "kind", kind: "select", label: words.tracker, options: words.kinds }]} />
      <div class="grid">
        <FormFields {...form} fields={fieldsOf(noise.kind)} />
      </div>
    </fieldset>
  );
}
