/** Deflection of each configuration before and after compensation (the paper's Figs 7 and 8), and the robot in it. */
import type { MeasurementSet, Posture, Residual, RunResult, Run } from "../api/types";
import type { Arrow } from "../scene/parts";
import { placesOf, norm, type Vector, bendOf, loadOf, add, times } from "../lib/vector";
import { roundStep, extent, significant, fixed } from "../lib/format";
import { useMemo, useCallback, useEffect, useState } from "preact/hooks";
import { BarFigure, ByName, circle, type Opening, Figure, Legend } from "../charts/figure";
import { LinkButton, Busy, Button, Choice, Toggle } from "../components/basics";
import { link } from "../state/action";
import { text } from "../i18n";
import { type RunContext, usePostures } from "./run_context";
import { Handle } from "../components/fields";
import { ArmView, roomOf } from "../scene/view";

export interface Arrows {
  measured: Arrow[];
  predicted: Arrow[];
  /** Lengths of the residuals [m], an arrow each. */
  residuals: number[];
  /** Names of the targets, an arrow each. */
  targets: string[];
}

export interface DrawnSet {
  byObservation: Arrows[];
  together: Arrows;
  /** Greatest length of a residual [m]. */
  worst: number;
}

/** The longest arrow is about this share of the robot's reach. */
const LONGEST = 0.22;

export function arrowsOf(set: MeasurementSet, postures: Posture[], result: RunResult): DrawnSet {
  const residuals = grouped(result.residuals);
  const byObservation = set.observations.map((observation, i): Arrows => {
    const posture = postures[i];
    const places = posture ? placesOf(set, observation, posture) : new Map<string, Vector>();
    const found = (residuals.get(observation.label) ?? []).filter((r) => places.has(r.target));
    const from = (target: string) => places.get(target) as Vector;
    return {
      measured: found.map((r) => ({ from: from(r.target), along: r.deflection })),
      predicted: found.map((r) => ({ from: from(r.target), along: r.predicted })),
      residuals: found.map((r) => norm(r.residual)),
      targets: found.map((r) => r.target),
    };
  });
  return {
    byObservation,
    together: {
      measured: byObservation.flatMap((a) => a.measured),
      predicted: byObservation.flatMap((a) => a.predicted),
      residuals: byObservation.flatMap((a) => a.residuals),
      targets: [],
    },
    worst: Math.max(1e-9, ...result.residuals.map((r) => norm(r.residual))),
  };
}

function grouped(residuals: Residual[]): Map<string, Residual[]> {
  const groups = new Map<string, Residual[]>();
  for (const residual of residuals) {
    const group = groups.get(residual.observation);
    if (group) group.push(residual);
    else groups.set(residual.observation, [residual]);
  }
  return groups;
}

/** A round factor by which deflections are drawn longer than they are. */
export function magnification({ together: { measured } }: DrawnSet, room: Vector[]): number {
  const longest = Math.max(1e-9, ...measured.map((arrow) => norm(arrow.along)));
  const reach = Math.max(0.2, ...room.map(norm));
  return roundStep((reach * LONGEST) / longest / 1.6, 1);
}

const AXES = ["x", "y", "z"] as const;

/** Mean lengths over the targets of each observation [m], in the order of the observations. */
export function byObservation(residuals: Residual[]): { name: string; before: number; after: number }[] {
  const sums = new Map<string, { before: number; after: number; count: number }>();
  for (const { observation, deflection, residual } of residuals) {
    const sum = sums.get(observation) ?? { before: 0, after: 0, count: 0 };
    sums.set(observation, {
      before: sum.before + norm(deflection),
      after: sum.after + norm(residual),
      count: sum.count + 1,
    });
  }
  return [...sums].map(([name, { before, after, count }]) => ({ name, before: before / count, after: after / count }));
}

export function DeflectionPart({
  context,
  result,
  at,
}: {
  context: RunContext;
  result: RunResult;
  /** The configuration that was come back from. */
  at: string | null;
}) {
  const opening: Opening = {
    open: (observation) => link(["runs", context.run.id, "robot"], { at: observation, from: "deflection" }),
    at,
  };
  return (
    <>
      <BeforeAfter result={result} run={context.run} opening={opening} />
      <div class="actions">
        <LinkButton href={link(["compare", "methods"], { set: context.set.id })}>{text.sets.compare}</LinkButton>
      </div>
      {result.contributions.length > 0 && (
        <BarFigure
          title={text.deflection.byConfiguration}
          note={text.deflection.byConfigurationNote}
          names={[...new Set(result.residuals.map((r) => r.observation))]}
          series={result.contributions.map(({ joint, by_observation: lengths }, j) => ({
            label: joint,
            mark: `joint-${j % 6}`,
            values: lengths.map((length) => length * 1e3),
          }))}
          unit={text.units.mm}
          stacked
          {...opening}
        />
      )}
      <Residuals result={result} opening={opening} />
    </>
  );
}

function BeforeAfter({ result, run, opening }: { result: RunResult; run: Run; opening: Opening }) {
  const words = text.deflection;
  const rows = useMemo(() => byObservation(result.residuals), [result]);
  const names = rows.map((row) => row.name);
  const own = words.afterBy(text.methods[run.request.method].toLowerCase());
  const series = [
    { mark: "measured", label: words.before, values: rows.map((row) => row.before * 1e3) },
    { mark: "predicted", label: own, values: rows.map((row) => row.after * 1e3) },
  ];
  return <BarFigure title={words.title} note={words.note} unit={text.units.mm} {...{ names, series }} {...opening} />;
}

function Residuals({ result, opening }: { result: RunResult; opening: Opening }) {
  const words = text.deflection;
  const names = useMemo(() => [...new Set(result.residuals.map((r) => r.observation))], [result]);
  const column = new Map(names.map((name, i) => [name, i]));
  const band = result.sigma === null ? null : 1.96 * Math.SQRT2 * result.sigma * 1e6;
  const dots = result.residuals.flatMap((r) =>
    AXES.map((axis, k) => ({
      column: column.get(r.observation) ?? 0,
      value: (r.residual[k] ?? 0) * 1e6,
      mark: axis,
      title: `${r.target}, ${axis}: ${significant((r.residual[k] ?? 0) * 1e6, 3)} ${text.units.micrometre}`,
    })),
  );
  const um = text.units.micrometre;
  return (
    <Figure
      title={words.residuals}
      note={words.residualsNote}
      legend={[
        ...AXES.map((axis) => ({ label: axis, mark: axis })),
        ...(band === null ? [] : [{ label: `${words.band} = ${significant(band, 2)} ${um}`, mark: "band" }]),
      ]}
      table={{
        columns: [
          words.configuration,
          words.target,
          ...AXES.map((axis) => ({ title: `${words.length} ${axis}`, unit: um })),
          ...AXES.map((axis) => ({ title: `${words.residual} ${axis}`, unit: um })),
        ],
        rows: result.residuals.map((r) => [
          r.observation,
          r.target,
          ...r.deflection.map((v) => v * 1e6),
          ...r.residual.map((v) => v * 1e6),
        ]),
      }}
    >
      {(width) => (
        <Scatter names={names} dots={dots} band={band} width={width} label={words.residuals} unit={um} {...opening} />
      )}
    </Figure>
  );
}

interface Dot {
  column: number;
  value: number;
  mark: string;
  title: string;
}

export function Scatter({
  dots,
  band,
  ...frame
}: {
  names: string[];
  dots: Dot[];
  /** Half width of the band, or null. */
  band: number | null;
  width: number;
  label: string;
  unit: string;
} & Opening) {
  const reach = Math.max(...(extent(dots.map((dot) => dot.value)) ?? [0, 1]).map(Math.abs), band ?? 0) || 1;
  const lines = (i: number) => dots.filter((dot) => dot.column === i).map((dot) => dot.title);
  return (
    <ByName {...frame} height={280} range={[-reach, reach]} lines={lines}>
      {(place, step, y) => (
        <>
          {band !== null && (
            <rect
              class="band"
              x={place(-0.5)}
              width={step * frame.names.length}
              y={y(band)}
              height={y(-band) - y(band)}
            />
          )}
          {[...new Set(dots.map(({ mark }) => mark))].map((mark) => (
            <path
              class={`dot ${mark}`}
              d={dots
                .filter((dot) => dot.mark === mark)
                .map(({ column, value }) =>
                  circle(place(column) + shift(mark) * Math.min(5, step / 4), y(value), radius(step)),
                )
                .join("")}
            />
          ))}
        </>
      )}
    </ByName>
  );
}

const radius = (step: number): number => Math.min(3.6, Math.max(1.5, step / 5));
const shift = (mark: string): number => (mark === "x" ? -1 : mark === "z" ? 1 : 0);

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
  if (!posture || !observation) return null;
  const own = drawn.byObservation[index] ?? drawn.together;
  const arrows = all ? drawn.together : own;
  const { point, force } = loadOf(set, observation, posture);
  const tips = own.measured.flatMap(({ from: foot, along }) => [foot, add(foot, times(along, factor))]);
  const points = [...roomOf([posture]), ...tips];
  const reach = Math.max(...points.map(norm));
  const pulls = norm(force) > 0;
  const room = pulls ? [...points, add(point, times(force, (0.3 * reach) / norm(force)))] : points;
  const compliances = result.joints.map((joint) => joint.compliance);
  const loadText = pulls ? `${fixed(norm(force), 0)} ${text.units.newton}` : `0 ${set.units.force}`;
  return (
    <section class="scene">
      <div class="view">
        <ArmView
          posture={posture}
          {...arrows}
          load={pulls ? { from: point, along: force } : null}
          factor={factor}
          axes={axes}
          names={labels ? result.joints.map((joint) => joint.name) : []}
          targets={all ? [] : arrows.targets}
          byResidual={colour === "residual" ? drawn.worst : null}
          bend={bendOf(posture, compliances, { point, force })}
          room={room}
          label={words.canvas(observation.label)}
          resets={resets}
          bends={bends}
        />
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
            { mark: "load", label: `${words.load}: ${loadText}` },
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
