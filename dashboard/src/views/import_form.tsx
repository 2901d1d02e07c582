/** What no file says: encoders, load, load point, places of targets, frame. Asked only where it is missing. */
import { useState } from "preact/hooks";
import { api } from "../api/client";
import type { ImportAnswer, ImportOptions } from "../api/types";
import { Prose } from "../components/basics";
import { TextField } from "../components/fields";
import { SchemaFields, type Terms } from "../components/schema_form";
import { posted } from "../lib/entered";
import { type Fields, unreadIn } from "../lib/json";
import { useLoad, valueOf } from "../state/load";
import { text } from "../i18n";
import { later } from "../i18n/later";

const words = later.imports;

const GRAVITY = 9.80665; // m/s², standard gravity

/** The unit of what is stated: that of a template, else mm, whatever the files have. */
/** Unit of the lengths that are stated: that of a template that has some, its noise among them. */
const lengthOf = ({
  length_unit: unit,
  load_point: point,
  flange_targets: targets,
  noise,
  units,
}: ImportOptions): string => unit ?? (point || targets || noise ? units?.length : null) ?? text.units.mm;

const termsOf = (options: ImportOptions): Terms => ({
  labels: words.labels,
  inView: ["encoders"],
  units: {
    force: [options.units?.force ?? text.units.newton, 1],
    load_point: [lengthOf(options), 1],
    flange_targets: [lengthOf(options), 1],
  },
});

const ASKED = ["force", "load_point", "flange_targets", "accept_unusual"] as const;

/** The options with what is stated, and its units. */
export function withStated(before: ImportOptions, next: Fields): ImportOptions {
  const { load_point: point, flange_targets: targets, force, units } = next as ImportOptions;
  return {
    ...next,
    ...(force ? { units: { ...units, force: before.units?.force ?? "N" } } : {}),
    ...(point || targets ? { length_unit: lengthOf(before) } : {}),
  } as ImportOptions;
}

/** What can be sent: without what is not understood yet, or was taken back. */
export const sent = (options: ImportOptions): ImportOptions =>
  Object.fromEntries(Object.entries(options).filter(([, value]) => value !== null && unreadIn([value]) === null));

export function ImportForm({
  answer,
  options,
  change,
}: {
  answer: ImportAnswer;
  options: ImportOptions;
  change: (options: ImportOptions) => void;
}) {
  const [mass, setMass] = useState("");
  const missing = new Set<string>(answer.missing_fields);
  const form = {
    of: "ImportRequest",
    value: options as Fields,
    change: (next: Fields) => change(withStated(options, next)),
    terms: termsOf(options),
  };
  const unusual = answer.missing.filter((_, i) => answer.missing_fields[i] === "accept_unusual");
  return (
    <div class="import-form">
      <SchemaFields {...form} show={["encoders", ...ASKED.filter((name) => missing.has(name) || options[name])]} />
      {(missing.has("force") || mass) && (
        <TextField
          label={words.mass}
          unit="kg"
          help={words.massHelp}
          value={mass}
          change={(typed) => {
            setMass(typed);
            const weight = posted(typed, GRAVITY);
            const force = typeof weight === "number" ? [0, 0, -weight] : null;
            change({ ...options, force, units: { ...options.units, force: "N" } } as ImportOptions);
          }}
        />
      )}
      {unusual.map((asked) => (
        <p class="note warn">
          <Prose text={asked} />
        </p>
      ))}
      <SchemaFields {...form} show={["name"]} />
    </div>
  );
}

/** The frame of the positions, where it is a tracker's: by a geometry of the robot, or by a transform. */
export function FrameForm({
  frame,
  change,
  robot,
  length,
}: {
  frame: Fields;
  change: (frame: Fields) => void;
  /** Whose geometries are offered; empty while none is chosen. */
  robot: string;
  /** The files' unit of length. */
  length: string;
}) {
  const geometries = valueOf(
    useLoad(
      async (signal) =>
        robot ? (await api.geometries.list({ robot_id: robot, state: "succeeded", limit: 20 }, signal)).items : [],
      [robot],
    ),
  );
  const terms: Terms = {
    labels: words.frame,
    within: "frame.",
    units: { translation: [length, 1] },
    choices: {
      geometry_id: [
        { value: "", label: words.noGeometry },
        ...(geometries ?? []).map(({ id, name }) => ({ value: id, label: name })),
      ],
    },
  };
  const by = frame["geometry_id"] ? [] : ["translation", "rotation"];
  return (
    <>
      <SchemaFields
        of="Frame-Input"
        show={["geometry_id", ...by, "forces"]}
        value={frame}
        change={change}
        terms={terms}
      />
      <p class="soft">{words.later}</p>
    </>
  );
}
