/** What no file says: encoders, load, load point, places of targets. Asked only where it is missing. */
import { api } from "../api/client";
import type { ImportAnswer } from "../api/types";
import { Choice, Prose, Toggle } from "../components/basics";
import { FaultsAt, NumberField, Select, TextField, VectorField } from "../components/fields";
import type { StatedFrame } from "../lib/frame";
import { useLoad, valueOf } from "../state/load";
import { text } from "../i18n";
import type { Stated } from "../lib/stated";

const words = text.imports;

export function ImportForm({
  answer,
  stated,
  change,
}: {
  answer: ImportAnswer;
  stated: Stated;
  change: (stated: Stated) => void;
}) {
  const set = (part: Partial<Stated>) => change({ ...stated, ...part });
  const missing = new Set<string>(answer.missing_fields);
  const load = stated.load === "mass" ? stated.mass : stated.force;
  return (
    <div class="import-form">
      <Choice
        label={words.encoders}
        value={stated.encoders}
        change={(encoders) => set({ encoders })}
        options={(["motor", "secondary"] as const).map((value) => ({ value, label: text.files.encoders[value] }))}
      />
      {(missing.has("force") || load.trim() !== "") && (
        <div class="load">
          <Choice
            label={words.load}
            value={stated.load}
            change={(load) => set({ load })}
            options={(["mass", "force"] as const).map((value) => ({ value, label: words.loads[value] }))}
          />
          {stated.load === "mass" ? (
            <NumberField
              label={words.mass}
              unit="kg"
              help={words.massHelp}
              value={stated.mass}
              change={(mass) => set({ mass })}
            />
          ) : (
            <VectorField
              label={words.force}
              unit={text.units.newton}
              help={words.forceHelp}
              placeholder="0, 0, -1500"
              value={stated.force}
              change={(force) => set({ force })}
            />
          )}
        </div>
      )}
      {(missing.has("load_point") || stated.loadPoint.trim() !== "") && (
        <VectorField
          label={words.loadPoint}
          unit={text.units.mm}
          help={words.loadPointHelp}
          placeholder="0, 0, 120"
          value={stated.loadPoint}
          change={(loadPoint) => set({ loadPoint })}
        />
      )}
      {(missing.has("flange_targets") || Object.values(stated.targets).some(Boolean)) &&
        answer.preview.targets.map((target) => (
          <VectorField
            label={words.placeOf(target)}
            unit={text.units.mm}
            help={words.placeHelp}
            value={stated.targets[target] ?? ""}
            change={(place) => set({ targets: { ...stated.targets, [target]: place } })}
          />
        ))}
      {(missing.has("accept_unusual") || stated.unusual) && (
        <div class="note warn">
          {answer.missing
            .filter((_, i) => answer.missing_fields[i] === "accept_unusual")
            .map((asked) => (
              <p>
                <Prose text={asked} />
              </p>
            ))}
          <Toggle label={words.unusual} checked={stated.unusual} change={(unusual) => set({ unusual })} />
        </div>
      )}
      <TextField
        label={words.name}
        placeholder={answer.measurement_set?.name ?? ""}
        value={stated.name}
        change={(name) => set({ name })}
      />
    </div>
  );
}

const frameWords = text.frame;

/** The frame of the positions, where it is a tracker's: by a geometry of the robot, or by a transform. */
export function FrameForm({
  frame,
  change,
  robot,
  length,
}: {
  frame: StatedFrame;
  change: (frame: StatedFrame) => void;
  /** Whose geometries are offered; empty while none is chosen. */
  robot: string;
  /** The files' unit of length. */
  length: string;
}) {
  const set = (part: Partial<StatedFrame>) => change({ ...frame, ...part });
  const geometries = valueOf(
    useLoad(
      async (signal) =>
        robot ? (await api.geometries.list({ robot_id: robot, state: "succeeded", limit: 20 }, signal)).items : [],
      [robot],
    ),
  );
  return (
    <div class="import-form">
      <Select
        label={frameWords.positions}
        help={frameWords.help}
        value={frame.of}
        change={(of) => set({ of })}
        options={[
          { value: "", label: frameWords.base },
          ...(geometries ?? []).map(({ id, name }) => ({ value: id, label: frameWords.geometry(name) })),
          { value: "transform", label: frameWords.transform },
        ]}
      />
      {frame.of === "transform" && (
        <>
          <VectorField
            label={frameWords.origin}
            unit={length}
            value={frame.translation}
            change={(translation) => set({ translation })}
            path="frame.translation"
          />
          {frame.rows.map((row, i) => (
            <VectorField
              label={frameWords.row(i + 1)}
              value={row}
              change={(typed) =>
                set({ rows: frame.rows.map((old, j) => (j === i ? typed : old)) as StatedFrame["rows"] })
              }
              path={i === 2 ? "frame.rotation" : undefined}
            />
          ))}
        </>
      )}
      {frame.of !== "" && (
        <>
          <Choice
            label={frameWords.forces}
            value={frame.forces}
            change={(forces) => set({ forces })}
            options={{ base: frameWords.forcesBase, tracker: frameWords.forcesTracker }}
          />
          <p class="soft">{frameWords.later}</p>
          <FaultsAt path="frame.geometry_id" />
        </>
      )}
    </div>
  );
}
