/** What a map is asked: a box around what was measured, a process force, the tool, and which posture to take. */
import { useMemo, useState } from "preact/hooks";
import { api } from "../api/client";
import { ActionButton, Busy, Button, Choice, Toggle } from "../components/basics";
import { DropZone } from "../components/drop";
import { Fields, Select, TextField, VectorField } from "../components/fields";
import { freshKey } from "../lib/hash";
import { numbersIn } from "../lib/program";
import { asking, useAction } from "../state/action";
import { go, link } from "../state/router";
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
  const [least, setLeast] = useState(start.least);
  const [greatest, setGreatest] = useState(start.greatest);
  const [grid, setGrid] = useState("15, 15, 5");
  const [force, setForce] = useState(start.force);
  const [tool, setTool] = useState(start.tool);
  const [axis, setAxis] = useState("0, 0, 1");
  const [direction, setDirection] = useState(start.direction);
  const [turns, setTurns] = useState("8");
  const [posture, setPosture] = useState<"stiffest" | "nearest">("stiffest");
  const [near, setNear] = useState("0");
  const make = useAction(async () => {
    const { angle } = factors(set.units);
    const joints = set.observations[Number(near)]?.joints.map((value) => value * angle);
    const stated = {
      run_id: run.id,
      area: [metres(least), metres(greatest)],
      grid: vectorIn(grid),
      place: metres(tool),
      tool_axis: vectorIn(axis),
      directions: [vectorIn(direction)],
      turns: Number(turns),
      force: vectorIn(force),
      ...(posture === "nearest" && joints ? { near: joints } : {}),
    };
    const made = await asking((accepted) => api.maps.add({ ...stated, ...accepted }, freshKey("map")));
    go(link(["maps", made.id]));
  });
  const { mm, newton } = text.units;
  return (
    <Fields action={make} look="card form">
      <h2>{words.form}</h2>
      <p>{words.formNote}</p>
      <div class="map-fields">
        <VectorField path="area[0]" label={words.least} unit={mm} value={least} change={setLeast} />
        <VectorField path="area[1]" label={words.greatest} unit={mm} value={greatest} change={setGreatest} />
        <VectorField path="grid" label={words.grid} value={grid} change={setGrid} />
        <VectorField path="force" label={words.force} unit={newton} value={force} change={setForce} />
        <VectorField path="place" label={words.tool} unit={mm} value={tool} change={setTool} />
        <VectorField path="tool_axis" label={words.toolAxis} value={axis} change={setAxis} />
        <VectorField path="directions" label={words.direction} value={direction} change={setDirection} />
        <TextField path="turns" label={words.turns} type="number" min={1} max={360} value={turns} change={setTurns} />
      </div>
      <Choice
        label={words.posture}
        value={posture}
        change={setPosture}
        options={{ stiffest: words.stiffest, nearest: words.nearest }}
      />
      {posture === "nearest" && (
        <Select
          label={words.nearestTo}
          value={near}
          change={setNear}
          options={set.observations.map((one, i) => ({ value: String(i), label: one.label }))}
        />
      )}
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

/** What a program is corrected for: its files, tool, base, process force, and the controller's accuracy option. */
export function ProgramForm({ context: { run } }: { context: RunContext }) {
  const [files, setFiles] = useState<File[]>([]);
  const [accuracy, setAccuracy] = useState("");
  const [force, setForce] = useState("0 0 -500");
  const [axes, setAxes] = useState("robot");
  const [tool, setTool] = useState("");
  const [base, setBase] = useState("");
  const [start, setStart] = useState("");
  const [leave, setLeave] = useState(false);
  const make = useAction(async () => {
    const frame = (value: string) => (value.trim() ? [{ values: numbersIn(value) ?? [] }] : []);
    const stated = {
      run_id: run.id,
      units: { length: "mm", angle: "deg", force: "N" },
      accuracy_option: accuracy,
      load: { force: numbersIn(force) ?? [] },
      axes,
      tools: frame(tool),
      bases: frame(base),
      ...(start.trim() ? { start: numbersIn(start) ?? [] } : {}),
      ...(leave ? { leave_others: true } : {}),
    };
    const made = await asking((accepted) => api.addProgram(files, { ...stated, ...accepted }, freshKey("program")));
    go(link(["programs", made.id]));
  });
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
      <Select
        label={programWords.accuracy}
        value={accuracy}
        change={setAccuracy}
        options={ACCURACY.map((value) => ({ value, label: programWords.accuracies[value || "none"] }))}
      />
      <div class="map-fields">
        <Numbers label={`${programWords.force} [${text.units.newton}]`} path="load" value={force} change={setForce} />
        <Select
          label={programWords.axes}
          value={axes}
          change={setAxes}
          options={(["robot", "tool", "base"] as const).map((value) => ({ value, label: programWords.axesOf[value] }))}
        />
        <Numbers label={programWords.tool} path="tools" value={tool} change={setTool} help={programWords.frameHint} />
        <Numbers label={programWords.base} path="bases" value={base} change={setBase} help={programWords.frameHint} />
        <Numbers
          label={`${programWords.start} [${text.units.deg}, ${text.units.mm}]`}
          path="start"
          value={start}
          change={setStart}
          help={programWords.startHint}
        />
      </div>
      {(leave || make.problem?.type === NOT_UNDERSTOOD) && (
        <Toggle label={programWords.leave} checked={leave} change={setLeave} />
      )}
      <ActionButton look="primary" action={make} disabled={files.length === 0 || accuracy === ""}>
        {programWords.make}
      </ActionButton>
    </Fields>
  );
}

const Numbers = ({ value, ...rest }: Parameters<typeof TextField>[0]) => (
  <TextField {...rest} value={value} aria-invalid={numbersIn(value) === null} />
);
