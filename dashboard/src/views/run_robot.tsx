/** The robot in each configuration, its load, and its deflection, measured and predicted. */
import { useCallback, useEffect, useMemo, useState } from "preact/hooks";
import type { MeasurementSet, Posture, Residual, RunResult } from "../api/types";
import { Busy, Toggle } from "../parts/basics";
import { DataTable } from "../parts/table";
import { loadOf, placesOf } from "../pure/places";
import { fixed } from "../pure/format";
import { roundStep } from "../pure/scale";
import { norm, type Vector } from "../pure/vector";
import type { Arrow } from "../scene/arrows";
import type { Show } from "../scene/stage";
import { ArmView, roomOf } from "../scene/view";
import { text } from "../text";
import type { RunContext } from "./run_context";
import { usePostures } from "./run_postures";

interface Arrows {
  measured: Arrow[];
  predicted: Arrow[];
}

/** The longest arrow is about this share of the robot's reach. */
const LONGEST = 0.22;

export function RobotPart({ context: { set, robot }, result }: { context: RunContext; result: RunResult }) {
  const postures = usePostures(set, robot);
  return postures ? <Stepper set={set} postures={postures} result={result} /> : <Busy label={text.scene.loading} />;
}

function Stepper({ set, postures, result }: { set: MeasurementSet; postures: Posture[]; result: RunResult }) {
  const [index, setIndex] = useState(0);
  const [all, setAll] = useState(false);
  const [axes, setAxes] = useState(true);
  const [resets, setResets] = useState(0);
  const room = useMemo(() => roomOf(postures), [postures]);
  const byObservation = useMemo(() => arrowsOf(set, postures, result), [set, postures, result]);
  const together = useMemo<Arrows>(
    () => ({
      measured: byObservation.flatMap((a) => a.measured),
      predicted: byObservation.flatMap((a) => a.predicted),
    }),
    [byObservation],
  );
  const [factor, setFactor] = useState(() => magnification(together, room));
  const step = useCallback(
    (by: number) => setIndex((i) => (i + by + postures.length) % postures.length),
    [postures.length],
  );
  useStepKeys(step);
  const posture = postures[index];
  const observation = set.observations[index];
  const show = useMemo<Show | null>(() => {
    if (!posture || !observation) return null;
    const { point, force } = loadOf(set, observation, posture);
    const arrows = all ? together : (byObservation[index] ?? { measured: [], predicted: [] });
    return { posture, ...arrows, load: norm(force) > 0 ? { from: point, along: force } : null, factor, axes };
  }, [posture, observation, all, together, byObservation, index, factor, axes]);
  if (!show || !observation) return null;
  const words = text.scene;
  return (
    <section class="scene">
      <ArmView show={show} room={room} label={words.canvas(observation.label)} resets={resets} />
      <div class="controls">
        <div class="stepper">
          <button type="button" class="button" aria-label={words.previous} onClick={() => step(-1)}>
            ‹
          </button>
          <label>
            <span>
              <bdi>{observation.label}</bdi> <small class="soft">{words.of(index + 1, postures.length)}</small>
            </span>
            <input
              type="range"
              min={0}
              max={postures.length - 1}
              step={1}
              value={index}
              aria-label={words.configuration}
              aria-valuetext={observation.label}
              onInput={(event) => setIndex(Number(event.currentTarget.value))}
            />
          </label>
          <button type="button" class="button" aria-label={words.next} onClick={() => step(1)}>
            ›
          </button>
        </div>
        <ul class="legend">
          <li>
            <i class="mark load" aria-hidden="true" />
            {words.load}: {loadText(set, show)}
          </li>
          <li>
            <i class="mark measured" aria-hidden="true" />
            {words.measured}
          </li>
          <li>
            <i class="mark predicted" aria-hidden="true" />
            {words.predicted}
          </li>
        </ul>
        <div class="magnify">
          <button
            type="button"
            class="button"
            aria-label={words.scaleDown}
            onClick={() => setFactor((f) => roundStep(f / 2.2, 1))}
          >
            −
          </button>
          <output>{words.magnified(fixed(factor, 0))}</output>
          <button
            type="button"
            class="button"
            aria-label={words.scaleUp}
            onClick={() => setFactor((f) => roundStep(f * 1.8, 1))}
          >
            +
          </button>
        </div>
        <div class="toggles">
          <Toggle label={words.all} checked={all} change={setAll} />
          <Toggle label={words.axes} checked={axes} change={setAxes} />
          <button type="button" class="button" onClick={() => setResets((n) => n + 1)}>
            {words.reset}
          </button>
        </div>
        <p class="soft">{words.hint}</p>
        <details>
          <summary>{words.table}</summary>
          <DeflectionTable label={observation.label} result={result} />
        </details>
      </div>
    </section>
  );
}

/** Page up and down step through the configurations, wherever the focus is. */
function useStepKeys(step: (by: number) => void): void {
  useEffect(() => {
    const hear = (event: KeyboardEvent) => {
      const by = { PageDown: 1, PageUp: -1 }[event.key];
      if (by === undefined || event.target instanceof HTMLInputElement) return;
      event.preventDefault();
      step(by);
    };
    addEventListener("keydown", hear);
    return () => removeEventListener("keydown", hear);
  }, [step]);
}

function arrowsOf(set: MeasurementSet, postures: Posture[], result: RunResult): Arrows[] {
  const residuals = grouped(result.residuals);
  return set.observations.map((observation, i) => {
    const posture = postures[i];
    const places = posture ? placesOf(set, observation, posture) : new Map<string, Vector>();
    const found = (residuals.get(observation.label) ?? []).filter((r) => places.has(r.target));
    const from = (target: string) => places.get(target) as Vector;
    return {
      measured: found.map((r) => ({ from: from(r.target), along: r.deflection })),
      predicted: found.map((r) => ({ from: from(r.target), along: r.predicted })),
    };
  });
}

function grouped(residuals: Residual[]): Map<string, Residual[]> {
  const groups = new Map<string, Residual[]>();
  for (const residual of residuals)
    groups.set(residual.observation, [...(groups.get(residual.observation) ?? []), residual]);
  return groups;
}

function magnification({ measured }: Arrows, room: Vector[]): number {
  const longest = Math.max(1e-9, ...measured.map((arrow) => norm(arrow.along)));
  const reach = Math.max(0.2, ...room.map(norm));
  return roundStep((reach * LONGEST) / longest / 1.6, 1);
}

function loadText(set: MeasurementSet, show: Show): string {
  return show.load ? `${fixed(norm(show.load.along), 0)} ${text.units.newton}` : `0 ${set.units.force}`;
}

function DeflectionTable({ label, result }: { label: string; result: RunResult }) {
  const words = text.scene;
  const mm = (vector: readonly number[]) => vector.map((v) => v * 1e3);
  const show = (v: number) => fixed(v, 3);
  const axes = ["x", "y", "z"];
  return (
    <DataTable
      caption={words.table}
      table={{
        columns: [
          { title: text.deflection.target },
          ...axes.map((a) => ({ title: `${words.measured} ${a}`, unit: text.units.mm, show })),
          ...axes.map((a) => ({ title: `${words.predicted} ${a}`, unit: text.units.mm, show })),
        ],
        rows: result.residuals
          .filter((r) => r.observation === label)
          .map((r) => [r.target, ...mm(r.deflection), ...mm(r.predicted)]),
      }}
    />
  );
}
