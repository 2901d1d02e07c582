/** What a map is asked: a box around what was measured, a process force, the tool, and which posture to take. */
import type { ComponentChildren } from "preact";
import { useMemo, useState } from "preact/hooks";
import { api } from "../api/client";
import type { Posture } from "../api/types";
import { Busy, Choice, ProblemNote } from "../components/basics";
import { TextField, Select } from "../components/fields";
import { freshKey } from "../lib/hash";
import { boxAround } from "../lib/map";
import { loadOf } from "../lib/places";
import { factors } from "../lib/units";
import { add, norm, times, type Vector } from "../lib/vector";
import { asking, useAction } from "../state/action";
import { go, link } from "../state/router";
import { text } from "../i18n";
import type { RunContext } from "./run_context";
import { usePostures } from "./run_postures";

const words = text.map;
const TRIPLE = [0, 1, 2] as const;
type Triple = [string, string, string];

export function MapForm({ context }: { context: RunContext }) {
  const postures = usePostures(context.set, context.robot);
  return postures ? <Form context={context} postures={postures} /> : <Busy />;
}

function Form({ context: { run, set }, postures }: { context: RunContext; postures: Posture[] }) {
  const start = useMemo(() => proposal(set, postures), [set, postures]);
  const [least, setLeast] = useState<Triple>(start.least);
  const [greatest, setGreatest] = useState<Triple>(start.greatest);
  const [grid, setGrid] = useState<Triple>(["15", "15", "5"]);
  const [force, setForce] = useState<Triple>(start.force);
  const [tool, setTool] = useState<Triple>(start.tool);
  const [axis, setAxis] = useState<Triple>(["0", "0", "1"]);
  const [direction, setDirection] = useState<Triple>(start.direction);
  const [turns, setTurns] = useState("8");
  const [posture, setPosture] = useState<"stiffest" | "nearest">("stiffest");
  const [near, setNear] = useState("0");
  const make = useAction(async () => {
    const { angle } = factors(set.units);
    const joints = set.observations[Number(near)]?.joints.map((value) => value * angle);
    const stated = {
      run_id: run.id,
      area: [metres(least), metres(greatest)],
      grid: numbers(grid),
      place: metres(tool),
      tool_axis: numbers(axis),
      directions: [numbers(direction)],
      turns: Number(turns),
      force: numbers(force),
      ...(posture === "nearest" && joints ? { near: joints } : {}),
    };
    const made = await asking((accepted) => api.maps.add({ ...stated, ...accepted }, freshKey("map")));
    go(link(["maps", made.id]));
  });
  const { mm, newton } = text.units;
  return (
    <section class="card form">
      <h2>{words.form}</h2>
      <p>{words.formNote}</p>
      <div class="map-fields">
        <Three label={`${words.least} [${mm}]`} values={least} change={setLeast} />
        <Three label={`${words.greatest} [${mm}]`} values={greatest} change={setGreatest} />
        <Three label={words.grid} values={grid} change={setGrid} />
        <Three label={`${words.force} [${newton}]`} values={force} change={setForce} />
        <Three label={`${words.tool} [${mm}]`} values={tool} change={setTool} />
        <Three label={words.toolAxis} values={axis} change={setAxis} />
        <Three label={words.direction} values={direction} change={setDirection} />
        <TextField label={words.turns} type="number" min={1} max={360} value={turns} change={setTurns} />
      </div>
      <Choice
        label={words.posture}
        value={posture}
        change={setPosture}
        options={[
          { value: "stiffest", label: words.stiffest },
          { value: "nearest", label: words.nearest },
        ]}
      />
      {posture === "nearest" && (
        <Select
          label={words.nearestTo}
          value={near}
          change={setNear}
          options={set.observations.map((one, i) => ({ value: String(i), label: one.label }))}
        />
      )}
      {make.problem && <ProblemNote problem={make.problem} />}
      <button type="button" class="button primary" disabled={make.busy} onClick={make.run}>
        {words.make}
      </button>
    </section>
  );
}

/** Three numbers along x, y and z. */
function Three({
  label,
  values,
  change,
}: {
  label: ComponentChildren;
  values: Triple;
  change: (values: Triple) => void;
}) {
  return (
    <fieldset>
      <legend>{label}</legend>
      <div class="triple">
        {TRIPLE.map((i) => (
          <input
            type="number"
            step="any"
            aria-label={`${label} ${"xyz"[i]}`}
            value={values[i]}
            onInput={(event) => {
              const next: Triple = [...values];
              next[i] = event.currentTarget.value;
              change(next);
            }}
          />
        ))}
      </div>
    </fieldset>
  );
}

/** The box of the load points, the strongest force, and the mean way the flange looked. */
function proposal(set: RunContext["set"], postures: Posture[]) {
  const loads = postures.flatMap((posture, i) => {
    const observation = set.observations[i];
    return observation ? [loadOf(set, observation, posture)] : [];
  });
  const [least, greatest] = boxAround(loads.map((load) => load.point));
  const strongest = loads.reduce<Vector>((best, { force }) => (norm(force) > norm(best) ? force : best), [0, 0, -500]);
  const sum = postures.reduce<Vector>((all, { flange_axes: axes }) => add(all, axes[2] ?? [0, 0, 0]), [0, 0, 0]);
  const mean: Vector = norm(sum) > 0.2 * postures.length ? times(sum, 1 / norm(sum)) : [0, 0, -1];
  const point = times(set.load_point ?? set.observations[0]?.load_point ?? [0, 0, 0], factors(set.units).length);
  const shown = (vector: Vector, digits: number): Triple =>
    vector.map((value) => String(Number(value.toFixed(digits)))) as Triple;
  return {
    least: shown(times(least, 1e3), 0),
    greatest: shown(times(greatest, 1e3), 0),
    force: shown(strongest, 0),
    tool: shown(times(point, 1e3), 1),
    direction: shown(mean, 2),
  };
}

const numbers = (values: Triple): number[] => values.map(Number);
const metres = (values: Triple): number[] => values.map((value) => Number(value) / 1e3);
