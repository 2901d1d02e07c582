/** What a map is asked: a box around what was measured, a process force, the tool, and which posture to take. */
import { useMemo, useState } from "preact/hooks";
import { api } from "../api/client";
import { ActionButton, Busy, Button, Toggle } from "../components/basics";
import { DropZone } from "../components/drop";
import { Fields } from "../components/fields";
import { FormFields } from "../components/form";
import { freshKey } from "../lib/hash";
import { numbersIn } from "../lib/program";
import { asking, useAction } from "../state/action";
import { useDraft } from "../state/kept";
import { link } from "../state/router";
import { text } from "../i18n";
import { type RunContext, usePostures } from "./run_context";
import type { Posture } from "../api/types";
import { typedOf, vectorIn } from "../lib/entered";
import { boxAround } from "../lib/map";
import { loadOf } from "../lib/places";
import { factors } from "../lib/units";
import { type Vector, add, norm, times } from "../lib/vector";

const words = text.map;

export function MapForm({ context }: { context: RunContext }) {
  const postures = usePostures(context.set, context.robot);
  return postures ? <Form context={context} postures={postures} /> : <Busy />;
}

function Form({ context: { run, set }, postures }: { context: RunContext; postures: Posture[] }) {
  const start = useMemo(() => proposal(set, postures), [set, postures]);
  const [asked, change] = useDraft(`map/${run.id}`, {
    ...start,
    grid: "15, 15, 5",
    axis: "0, 0, 1",
    turns: "8",
    posture: "stiffest",
    near: "0",
  });
  const make = useAction(async () => {
    const { angle } = factors(set.units);
    const joints = set.observations[Number(asked.near)]?.joints.map((value) => value * angle);
    const stated = {
      run_id: run.id,
      area: [metres(asked.least), metres(asked.greatest)],
      grid: vectorIn(asked.grid),
      place: metres(asked.tool),
      tool_axis: vectorIn(asked.axis),
      directions: [vectorIn(asked.direction)],
      turns: Number(asked.turns),
      force: vectorIn(asked.force),
      ...(asked.posture === "nearest" && joints ? { near: joints } : {}),
    };
    const made = await asking((accepted) => api.maps.add({ ...stated, ...accepted }, freshKey("map")));
    return link(["maps", made.id]);
  });
  const { mm, newton: unit } = text.units;
  const form = { values: asked, change };
  return (
    <Fields action={make} look="card form">
      <h2>{words.form}</h2>
      <p>{words.formNote}</p>
      <div class="map-fields">
        <FormFields
          {...form}
          fields={[
            { name: "least", kind: "vector", label: words.least, unit: mm, path: "area[0]" },
            { name: "greatest", kind: "vector", label: words.greatest, unit: mm, path: "area[1]" },
            { name: "grid", kind: "vector", label: words.grid, path: "grid" },
            { name: "force", kind: "vector", label: words.force, unit, path: "force" },
            { name: "tool", kind: "vector", label: words.tool, unit: mm, path: "place" },
            { name: "axis", kind: "vector", label: words.toolAxis, path: "tool_axis" },
            { name: "direction", kind: "vector", label: words.direction, path: "directions" },
            { name: "turns", label: words.turns, path: "turns", type: "number", min: 1, max: 360 },
          ]}
        />
      </div>
      <FormFields
        {...form}
        fields={[
          {
            name: "posture",
            kind: "choice",
            label: words.posture,
            options: { stiffest: words.stiffest, nearest: words.nearest },
          },
          {
            name: "near",
            kind: "select",
            label: words.nearestTo,
            options: set.observations.map(({ label }, i) => ({ value: String(i), label })),
            asked: asked.posture === "nearest",
          },
        ]}
      />
      <ActionButton look="primary" action={make}>
        {words.make}
      </ActionButton>
    </Fields>
  );
}

/** The box of the load points, the strongest force, and the mean way the flange looked. */
function proposal(set: RunContext["set"], postures: Posture[]) {
  const loads = postures.flatMap((posture, i) => {
    const observation = set.observations[i];
    return observation ? [loadOf(set, observation, posture)] : [];
  });
  const [least, greatest] = boxAround(loads.map((load) => load.point));
  const strongest = loads.reduce<Vector>((best, { force }) => (norm(force) > norm(best) ? force : best), [0, 0, 0]);
  const sum = postures.reduce<Vector>((all, { flange_axes: axes }) => add(all, axes[2] ?? [0, 0, 0]), [0, 0, 0]);
  const mean: Vector = norm(sum) > 0.2 * postures.length ? times(sum, 1 / norm(sum)) : [0, 0, -1];
  const point = times(set.load_point ?? set.observations[0]?.load_point ?? [0, 0, 0], factors(set.units).length);
  return {
    least: typedOf(times(least, 1e3), 0),
    greatest: typedOf(times(greatest, 1e3), 0),
    force: typedOf(norm(strongest) > 0 ? strongest : [0, 0, -500], 0),
    tool: typedOf(times(point, 1e3), 1),
    direction: typedOf(mean, 2),
  };
}

const metres = (typed: string): Vector | null => {
  const vector = vectorIn(typed);
  return vector ? times(vector, 1e-3) : null;
};

const programWords = text.program;
const NOT_UNDERSTOOD = "urn:jointstiff:problem:invalid-file";
const ACCURACY = ["", "off", "same_as_measured", "compensates_load"] as const;

const PROGRAM_FIELDS = [
  {
    name: "accuracy",
    kind: "select",
    label: programWords.accuracy,
    options: ACCURACY.map((value) => ({ value, label: programWords.accuracies[value || "none"] })),
  },
  { name: "force", kind: "numbers", label: programWords.force, unit: text.units.newton, path: "load" },
  { name: "axes", kind: "select", label: programWords.axes, options: programWords.axesOf },
  { name: "tool", kind: "numbers", label: programWords.tool, path: "tools", help: programWords.frameHint },
  { name: "base", kind: "numbers", label: programWords.base, path: "bases", help: programWords.frameHint },
  {
    name: "start",
    kind: "numbers",
    label: programWords.start,
    unit: `${text.units.deg}, ${text.units.mm}`,
    path: "start",
    help: programWords.startHint,
  },
] as const;

/** What a program is corrected for: its files, tool, base, process force, and the controller's accuracy option. */
export function ProgramForm({ context: { run } }: { context: RunContext }) {
  const [files, setFiles] = useState<File[]>([]);
  const [asked, change] = useDraft(`program/${run.id}`, {
    accuracy: "",
    force: "0 0 -500",
    axes: "robot",
    tool: "",
    base: "",
    start: "",
  });
  const [leave, setLeave] = useState(false);
  const make = useAction(async () => {
    const frame = (value: string) => (value.trim() ? [{ values: numbersIn(value) ?? [] }] : []);
    const stated = {
      run_id: run.id,
      units: { length: "mm", angle: "deg", force: "N" },
      accuracy_option: asked.accuracy,
      load: { force: numbersIn(asked.force) ?? [] },
      axes: asked.axes,
      tools: frame(asked.tool),
      bases: frame(asked.base),
      ...(asked.start.trim() ? { start: numbersIn(asked.start) ?? [] } : {}),
      ...(leave ? { leave_others: true } : {}),
    };
    const made = await asking((accepted) => api.addProgram(files, { ...stated, ...accepted }, freshKey("program")));
    return link(["programs", made.id]);
  });
  const form = { values: asked, change };
  const take = (file: File) => {
    setFiles((before) => [...before.filter((one) => one.name !== file.name), file]);
    setLeave(false); // confirmed for the lines of another program
  };
  return (
    <Fields action={make} look="card form">
      <h2>{programWords.form}</h2>
      <p>{programWords.formNote}</p>
      <DropZone
        title={programWords.drop}
        hint={programWords.dropHint}
        button={programWords.choose}
        accept={programWords.accept}
        take={take}
      />
      {files.length > 0 && (
        <ul>
          {files.map((file) => (
            <li>
              <bdi>{file.name}</bdi>{" "}
              <Button look="quiet" onClick={() => setFiles(files.filter((one) => one.name !== file.name))}>
                {programWords.remove}
              </Button>
            </li>
          ))}
        </ul>
      )}
      <FormFields {...form} fields={PROGRAM_FIELDS.slice(0, 1)} />
      <div class="map-fields">
        <FormFields {...form} fields={PROGRAM_FIELDS.slice(1)} />
      </div>
      {(leave || make.problem?.type === NOT_UNDERSTOOD) && (
        <Toggle label={programWords.leave} checked={leave} change={setLeave} />
      )}
      <ActionButton look="primary" action={make} disabled={files.length === 0 || asked.accuracy === ""}>
        {programWords.make}
      </ActionButton>
    </Fields>
  );
}
