/** Deflection of each configuration before and after compensation (the paper's Figs 7 and 8), and the robot in it. */
import type { MeasurementSet, Posture, RunResult } from "../../api/types";
import { groupedBy } from "../../lib/json";
import { norm, bendOf, loadOf, add, times } from "../../lib/vector";
import { roundStep, significant, fixed } from "../../lib/format";
import { useMemo, useCallback, useEffect, useState } from "preact/hooks";
import { BarFigure, ByName, circle, type Opening, Figure, Legend } from "../../charts/figure";
import { LinkButton, Busy, useArmBeside, Button, Choice, Toggle } from "../../components/basics";
import { link } from "../../state/action";
import { alike } from "../../components/table";
import { text } from "../../words";
import { type PartProps, usePostures } from "../../state/run_context";
import { Handle } from "../../components/fields";
import { ArmView, roomOf } from "../../scene/view";
import { sceneWords } from "../../scene/words";
import { chooseJoint, chosenIn } from "./chosen";
import { deflectionWords } from "./words";
import { type Arrows, arrowsOf, byObservation, magnification } from "./arrows";

const AXES = ["x", "y", "z"] as const;

export function DeflectionPart({ context: { run, set }, result, query }: PartProps) {
  const words = deflectionWords;
  const { mm } = text.units;
  const chosen = chosenIn(query);
  const isBeside = useArmBeside();
  const opening: Opening = {
    open: (observation) =>
      isBeside
        ? link(["runs", run.id, "deflection"], { ...Object.fromEntries(query), at: observation })
        : link(["runs", run.id, "robot"], { at: observation, from: "deflection" }),
    at: chosen.at, // also the configuration that was come back from
  };
  const rows = byObservation(result.residuals);
  const names = rows.map(({ name }) => name);
  const own = words.afterBy(text.methods[run.request.method].toLowerCase());
  const sides = [
    { mark: "measured", label: words.before, values: rows.map((row) => row.before * 1e3) },
    { mark: "predicted", label: own, values: rows.map((row) => row.after * 1e3) },
  ];
  const parts = result.contributions.map(({ joint, by_observation: lengths }, j) => ({
    label: joint,
    mark: `joint-${j % 6}`,
    values: lengths.map((length) => length * 1e3),
    choose: () => chooseJoint(joint),
    chosen: joint === chosen.joint,
  }));
  const { byConfiguration: title, byConfigurationNote: note } = words;
  return (
    <>
      <BarFigure title={words.title} note={words.note} unit={mm} {...{ names }} series={sides} {...opening} />
      <div class="actions">
        <LinkButton href={link(["compare", "methods"], { set: set.id })}>{text.sets.compare}</LinkButton>
      </div>
      {parts.length > 0 && <BarFigure {...{ title, note, names }} series={parts} unit={mm} stacked {...opening} />}
      <Residuals result={result} opening={opening} />
    </>
  );
}

/** Residuals of each configuration along each axis, and the band that the noise alone fills. */
function Residuals({ result, opening }: { result: RunResult; opening: Opening }) {
  const words = deflectionWords;
  const um = text.units.micrometre;
  const groups = [...groupedBy(result.residuals, ({ observation }) => observation)];
  const band = result.sigma === null ? 0 : 1.96 * Math.SQRT2 * result.sigma * 1e6;
  const reach = Math.max(band, ...result.residuals.flatMap(({ residual }) => residual.map((v) => Math.abs(v * 1e6))));
  const lines = (i: number) =>
    (groups[i]?.[1] ?? []).flatMap(({ target, residual }) =>
      residual.map((value, k) => `${target}, ${AXES[k]}: ${significant(value * 1e6, 3)} ${um}`),
    );
  return (
    <Figure
      title={words.residuals}
      note={words.residualsNote}
      legend={[
        ...AXES.map((axis) => ({ label: axis, mark: axis })),
        ...(band > 0 ? [{ label: `${words.band} = ${significant(band, 2)} ${um}`, mark: "band" }] : []),
      ]}
      table={{
        columns: [
          text.figure.configuration,
          words.target,
          ...alike(
            [words.length, words.residual].flatMap((quantity) => AXES.map((axis) => `${quantity} ${axis}`)),
            um,
          ),
        ],
        rows: result.residuals.map(({ observation, target, deflection, residual }) => [
          observation,
          target,
          ...[...deflection, ...residual].map((v) => v * 1e6),
        ]),
      }}
    >
      {(width) => (
        <ByName
          names={groups.map(([name]) => name)}
          range={[-(reach || 1), reach || 1]}
          {...{ width, lines }}
          height={280}
          label={words.residuals}
          unit={um}
          {...opening}
        >
          {(place, step, y) => (
            <>
              {band > 0 && (
                <rect
                  class="band"
                  x={place(-0.5)}
                  width={step * groups.length}
                  y={y(band)}
                  height={y(-band) - y(band)}
                />
              )}
              {AXES.map((axis, k) => {
                const at = (i: number) => place(i) + (k - 1) * Math.min(5, step / 4);
                const dots = groups.flatMap(([, own], i) =>
                  own.map(({ residual }) => circle(at(i), y((residual[k] ?? 0) * 1e6), radius(step))),
                );
                return <path class={`dot ${axis}`} d={dots.join("")} />;
              })}
            </>
          )}
        </ByName>
      )}
    </Figure>
  );
}

const radius = (step: number): number => Math.min(3.6, Math.max(1.5, step / 5));

const words = sceneWords;

export function RobotPart(props: PartProps) {
  const postures = usePostures(props.context.set, props.context.robot);
  return postures ? <Stepper postures={postures} {...props} /> : <Busy label={words.loading} />;
}

function Stepper({ context: { run, set }, postures, result, query }: PartProps & { postures: Posture[] }) {
  const asked = query.get("at");
  const from = query.get("from");
  const [index, setIndex] = useState(() => placeOf(set, asked));
  useEffect(() => setIndex(placeOf(set, asked)), [asked]);
  const [shown, show] = useState({ labels: true, axes: false, all: false });
  const [colour, setColour] = useState<"kind" | "residual">("kind");
  const [bends, setBends] = useState(0);
  const [resets, setResets] = useState(0);
  const drawn = useMemo(() => arrowsOf(set, postures, result), [set, postures, result]);
  const worst = Math.max(1e-9, ...result.residuals.map(({ residual }) => norm(residual)));
  const [factor, setFactor] = useState(() => magnification(drawn, roomOf(postures)));
  const step = useCallback(
    (by: number) => setIndex((i) => (i + by + postures.length) % postures.length),
    [postures.length],
  );
  useStepKeys(step);
  const posture = postures[index];
  const observation = set.observations[index];
  if (!posture || !observation) return null;
  const own = drawn[index] as Arrows;
  const arrows = shown.all
    ? {
        measured: drawn.flatMap((each) => each.measured),
        predicted: drawn.flatMap((each) => each.predicted),
        residuals: drawn.flatMap((each) => each.residuals),
        targets: [],
      }
    : own;
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
          axes={shown.axes}
          names={shown.labels ? result.joints.map((joint) => joint.name) : []}
          byResidual={colour === "residual" ? worst : null}
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
            label={text.figure.configuration}
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
            { mark: "load", label: `${text.files.facts.load}: ${loadText}` },
            ...(colour === "kind"
              ? (["measured", "predicted"] as const).map((mark) => ({ mark, label: words[mark] }))
              : [{ mark: "ramp", label: words.residualRamp(`${significant(worst * 1e3, 2)} ${text.units.mm}`) }]),
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
          options={{ kind: words.byKind, residual: deflectionWords.residual }}
        />
        <div class="toggles">
          {(["labels", "axes", "all"] as const).map((name) => (
            <Toggle label={words[name]} checked={shown[name]} change={(on) => show({ ...shown, [name]: on })} />
          ))}
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
