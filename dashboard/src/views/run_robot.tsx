/** The robot in each configuration, its load, and its deflection, measured and predicted. */
import type { MeasurementSet, Posture, RunResult } from "../api/types";
import { Legend } from "../charts/figure";
import { tip } from "../charts/tip";
import { fixed, significant } from "../lib/format";
import { useWidth } from "../state/size";
import { text } from "../i18n";
import { byObservation } from "./run_deflection";
import { useCallback, useEffect, useMemo, useState } from "preact/hooks";
import { Busy, Button, Choice, LinkButton, Toggle } from "../components/basics";
import { Handle } from "../components/fields";
import { DataTable } from "../components/table";
import { type DrawnSet, arrowsOf, magnification } from "../lib/drawn";
import { bendOf } from "../lib/bend";
import { loadOf } from "../lib/places";
import { roundStep } from "../lib/scale";
import { add, norm, times } from "../lib/vector";
import type { Show } from "../scene/show";
import { ArmView, roomOf } from "../scene/view";
import { link } from "../state/router";
import { type RunContext, usePostures } from "./run_context";

const words = text.scene;

interface RobotPartProps {
  context: RunContext;
  result: RunResult;
  query: URLSearchParams;
}

export function RobotPart({ context, result, query }: RobotPartProps) {
  const postures = usePostures(context.set, context.robot);
  return postures ? (
    <Stepper context={context} postures={postures} result={result} query={query} />
  ) : (
    <Busy label={words.loading} />
  );
}

function Stepper({ context: { run, set }, postures, result, query }: RobotPartProps & { postures: Posture[] }) {
  const asked = query.get("at");
  const from = query.get("from");
  const [index, setIndex] = useState(() => placeOf(set, asked));
  useEffect(() => setIndex(placeOf(set, asked)), [asked]);
  const [all, setAll] = useState(false);
  const [axes, setAxes] = useState(false);
  const [labels, setLabels] = useState(true);
  const [colour, setColour] = useState<"kind" | "residual">("kind");
  const [bends, setBends] = useState(0);
  const [resets, setResets] = useState(0);
  const drawn = useMemo<DrawnSet>(() => arrowsOf(set, postures, result), [set, postures, result]);
  const [factor, setFactor] = useState(() => magnification(drawn, roomOf(postures)));
  const step = useCallback(
    (by: number) => setIndex((i) => (i + by + postures.length) % postures.length),
    [postures.length],
  );
  useStepKeys(step);
  const posture = postures[index];
  const observation = set.observations[index];
  const room = useMemo(() => {
    if (!posture || !observation) return [];
    const tips = (drawn.byObservation[index]?.measured ?? []).flatMap(({ from: foot, along }) => [
      foot,
      add(foot, times(along, factor)),
    ]);
    const points = [...roomOf([posture]), ...tips];
    const { point, force } = loadOf(set, observation, posture);
    const reach = Math.max(...points.map(norm));
    return norm(force) > 0 ? [...points, add(point, times(force, (0.3 * reach) / norm(force)))] : points;
  }, [posture, observation, drawn, index, factor]);
  const show = useMemo<Show | null>(() => {
    if (!posture || !observation) return null;
    const { point, force } = loadOf(set, observation, posture);
    const arrows = all ? drawn.together : (drawn.byObservation[index] ?? drawn.together);
    return {
      posture,
      ...arrows,
      load: norm(force) > 0 ? { from: point, along: force } : null,
      factor,
      axes,
      names: labels ? result.joints.map((joint) => joint.name) : [],
      targets: all ? [] : arrows.targets,
      byResidual: colour === "residual" ? drawn.worst : null,
      bend: bendOf(
        posture,
        result.joints.map((joint) => joint.compliance),
        { point, force },
      ),
    };
  }, [posture, observation, all, drawn, index, factor, axes, labels, colour]);
  if (!show || !observation) return null;
  return (
    <section class="scene">
      <div class="view">
        <ArmView show={show} room={room} label={words.canvas(observation.label)} resets={resets} bends={bends} />
        <ResidualStrip result={result} names={set.observations.map((one) => one.label)} at={index} choose={setIndex} />
      </div>
      <div class="controls">
        {from && (
          <LinkButton look="quiet back" href={link(["runs", run.id, from], { at: observation.label })}>
            ‹ {words.backTo(text.run.views[from as keyof typeof text.run.views] ?? text.run.views.deflection)}
          </LinkButton>
        )}
        <div class="stepper">
          <Button aria-label={words.previous} onClick={() => step(-1)}>
            ‹
          </Button>
          <Handle
            look=""
            label={words.configuration}
            said={observation.label}
            count={postures.length}
            value={index}
            change={setIndex}
          >
            <bdi>{observation.label}</bdi> <small class="soft">{words.of(index + 1, postures.length)}</small>
          </Handle>
          <Button aria-label={words.next} onClick={() => step(1)}>
            ›
          </Button>
        </div>
        <Legend
          items={[
            { mark: "load", label: `${words.load}: ${loadText(set, show)}` },
            ...(colour === "kind"
              ? (["measured", "predicted"] as const).map((mark) => ({ mark, label: words[mark] }))
              : [{ mark: "ramp", label: words.residualRamp(`${significant(drawn.worst * 1e3, 2)} ${text.units.mm}`) }]),
          ]}
        />
        <div class="magnify">
          <Button aria-label={words.scaleDown} onClick={() => setFactor((f) => roundStep(f / 2.2, 1))}>
            −
          </Button>
          <output>{words.magnified(fixed(factor, 0))}</output>
          <Button aria-label={words.scaleUp} onClick={() => setFactor((f) => roundStep(f * 1.8, 1))}>
            +
          </Button>
        </div>
        <div class="buttons">
          <Button onClick={() => setBends((n) => n + 1)}>{words.bend}</Button>
          <Button onClick={() => setResets((n) => n + 1)}>{words.reset}</Button>
        </div>
        <Choice
          label={words.colour}
          value={colour}
          change={setColour}
          options={{ kind: words.byKind, residual: words.byResidual }}
        />
        <div class="toggles">
          <Toggle label={words.labels} checked={labels} change={setLabels} />
          <Toggle label={words.axes} checked={axes} change={setAxes} />
          <Toggle label={words.all} checked={all} change={setAll} />
        </div>
        <p class="soft">{words.hint}</p>
      </div>
      <details class="wide">
        <summary>{words.table}</summary>
        <DeflectionTable label={observation.label} result={result} />
      </details>
    </section>
  );
}

const placeOf = (set: MeasurementSet, label: string | null): number =>
  Math.max(
    0,
    set.observations.findIndex((one) => one.label === label),
  );

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

function loadText(set: MeasurementSet, show: Show): string {
  return show.load ? `${fixed(norm(show.load.along), 0)} ${text.units.newton}` : `0 ${set.units.force}`;
}

function DeflectionTable({ label, result }: { label: string; result: RunResult }) {
  const mm = (vector: readonly number[]) => vector.map((v) => v * 1e3);
  const show = (v: number) => fixed(v, 3);
  const axes = ["x", "y", "z"];
  return (
    <DataTable
      caption={words.table}
      table={{
        columns: [
          text.deflection.target,
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

const HEIGHT = 54;

/** What each configuration leaves unexplained, as a strip to step by: the worst are found at a glance. */
function ResidualStrip({
  result,
  names,
  at,
  choose,
}: {
  result: RunResult;
  names: string[];
  at: number;
  choose: (index: number) => void;
}) {
  const [box, width] = useWidth<HTMLDivElement>();
  const left = new Map(byObservation(result.residuals).map((one) => [one.name, one.after * 1e3]));
  const most = Math.max(1e-9, ...left.values());
  const step = width / Math.max(1, names.length);
  return (
    <div class="strip" ref={box}>
      <p class="soft">{text.scene.strip}</p>
      {width > 0 && (
        <svg width={width} height={HEIGHT} role="img" aria-label={text.scene.strip}>
          {names.map((name, i) => {
            const value = left.get(name) ?? 0;
            const high = (value / most) * (HEIGHT - 4);
            return (
              <g class={i === at ? "at" : undefined} onClick={() => choose(i)}>
                <rect class="left" x={i * step + step * 0.12} width={step * 0.76} y={HEIGHT - high} height={high} />
                <rect
                  class={i === at ? "hit column at" : "hit column"}
                  x={i * step}
                  width={step}
                  y={0}
                  height={HEIGHT}
                  {...tip([name, `${text.deflection.residual}: ${fixed(value, 3)} ${text.units.mm}`])}
                />
              </g>
            );
          })}
        </svg>
      )}
    </div>
  );
}
