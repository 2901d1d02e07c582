/** What a map is asked: a box around what was measured, a process force, the tool, and which posture to take. */
import type { ComponentProps } from "preact";
import { useMemo, useState } from "preact/hooks";
import { api } from "../api/client";
import type { Posture } from "../api/types";
import { ActionButton, Busy, Button, Toggle } from "../components/basics";
import { DropZone, SchemaFields } from "../components/schema_form";
import { RequestFields, Select, TextField } from "../components/fields";
import { freshKey, type Fields as Document, unreadIn } from "../lib/json";
import { boxAround, numbersIn } from "../lib/map";
import { loadOf, type Vector, add, norm, times } from "../lib/vector";
import { factors } from "../lib/stiffness";
import { asking, useAction, link } from "../state/action";
import { useDraft } from "../state/session";
import { text } from "../i18n";
import { later } from "../i18n/later";
import { type RunContext, usePostures } from "./run_context";

const words = later.map;

export function MapForm({ context }: { context: RunContext }) {
  const postures = usePostures(context.set, context.robot);
  return postures ? <Form context={context} postures={postures} /> : <Busy />;
}

function Form({ context: { run, set }, postures }: { context: RunContext; postures: Posture[] }) {
  const start = useMemo(() => proposal(set, postures), [set, postures]);
  const [asked, change] = useDraft<Document>(`map/${run.id}`, start);
  const [near, setNear] = useState("");
  const make = useAction(async () => {
    const { angle } = factors(set.units);
    const joints = near && set.observations[Number(near)]?.joints.map((value) => value * angle);
    const stated = { run_id: run.id, ...asked, ...(joints ? { near: joints } : {}) };
    const made = await asking((accepted) => api.maps.add({ ...stated, ...accepted }, freshKey("map")));
    return link(["maps", made.id]);
  });
  return (
    <RequestFields action={make} look="card form">
      <h2>{words.form}</h2>
      <p>{words.formNote}</p>
      <SchemaFields
        of="MapRequest-Input"
        show={["area", "grid", "force", "place", "tool_axis", "directions", "turns"]}
        value={asked}
        change={change}
        terms={{ labels: words.labels }}
      />
      <Select
        label={words.posture}
        value={near}
        change={setNear}
        options={[
          { value: "", label: words.stiffest },
          ...set.observations.map(({ label }, i) => ({ value: String(i), label: words.nearestTo(label) })),
        ]}
      />
      <ActionButton look="primary" action={make} disabled={unreadIn(asked) !== null}>
        {words.make}
      </ActionButton>
    </RequestFields>
  );
}

/** The box of the load points, the strongest force, and the mean way the flange looked. */
function proposal(set: RunContext["set"], postures: Posture[]): Document {
  const loads = postures.flatMap((posture, i) => {
    const observation = set.observations[i];
    return observation ? [loadOf(set, observation, posture)] : [];
  });
  const strongest = loads.reduce<Vector>((best, { force }) => (norm(force) > norm(best) ? force : best), [0, 0, 0]);
  const sum = postures.reduce<Vector>((all, { flange_axes: axes }) => add(all, axes[2] ?? [0, 0, 0]), [0, 0, 0]);
  const mean: Vector = norm(sum) > 0.2 * postures.length ? times(sum, 1 / norm(sum)) : [0, 0, -1];
  const point = times(set.load_point ?? set.observations[0]?.load_point ?? [0, 0, 0], factors(set.units).length);
  const rounded = (vector: Vector, digits: number) => vector.map((part) => Number(part.toFixed(digits)));
  return {
    area: boxAround(loads.map((load) => load.point)),
    grid: [15, 15, 5],
    force: rounded(norm(strongest) > 0 ? strongest : [0, 0, -500], 0),
    place: rounded(point, 4),
    tool_axis: [0, 0, 1],
    directions: [rounded(mean, 2)],
    turns: 8,
  };
}

const programWords = later.program;
const NOT_UNDERSTOOD = "urn:jointstiff:problem:invalid-file";
const ACCURACY = ["", "off", "same_as_measured", "compensates_load"] as const;

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
  const field = (name: "force" | "tool" | "base" | "start", rest: Partial<ComponentProps<typeof TextField>>) => (
    <TextField
      label={programWords[name]}
      value={asked[name]}
      change={(typed) => change({ [name]: typed })}
      aria-invalid={numbersIn(asked[name]) === null}
      {...rest}
    />
  );
  const take = (file: File) => {
    setFiles((before) => [...before.filter((one) => one.name !== file.name), file]);
    setLeave(false); // confirmed for the lines of another program
  };
  return (
    <RequestFields action={make} look="card form">
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
      <Select
        label={programWords.accuracy}
        value={asked.accuracy}
        change={(accuracy) => change({ accuracy })}
        options={ACCURACY.map((value) => ({ value, label: programWords.accuracies[value || "none"] }))}
      />
      <div class="fields">
        {field("force", { unit: text.units.newton, path: "load" })}
        <Select
          label={programWords.axes}
          value={asked.axes}
          change={(axes) => change({ axes })}
          options={programWords.axesOf}
        />
        {field("tool", { path: "tools", help: programWords.frameHint })}
        {field("base", { path: "bases", help: programWords.frameHint })}
        {field("start", {
          unit: `${text.units.deg}, ${text.units.mm}`,
          path: "start",
          help: programWords.startHint,
        })}
      </div>
      {(leave || make.problem?.type === NOT_UNDERSTOOD) && (
        <Toggle label={programWords.leave} checked={leave} change={setLeave} />
      )}
      <ActionButton look="primary" action={make} disabled={files.length === 0 || asked.accuracy === ""}>
        {programWords.make}
      </ActionButton>
    </RequestFields>
  );
}
