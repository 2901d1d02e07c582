/** How far the tool bends: a posture that was measured or typed, a force, and the arm bent by it. */
import { useMemo, useState } from "preact/hooks";
import { api } from "../api/client";
import type { DeflectionResult, Posture, RunResult } from "../api/types";
import { ActionButton, Busy, Button, Facts, Prose } from "../components/basics";
import { Select } from "../components/fields";
import { SchemaFields } from "../components/schema_form";
import { bendOf, loadOf, type Vector, add, fromFlange, norm, times } from "../lib/vector";
import { decimalsFor, fixed, percent, significant } from "../lib/format";
import { type Fields, unreadIn } from "../lib/json";
import { sentence } from "../lib/said";
import { roundStep } from "../lib/scale";
import { factors, position, positionIn, positionUnit } from "../lib/stiffness";
import { ARM_ALONE, ArmView, roomOf } from "../scene/view";
import { useAction } from "../state/action";
import { text } from "../i18n";
import { later } from "../i18n/later";
import { type RunContext, usePostures } from "./run_context";
import { VerdictCard } from "../components/job_page";

const words = later.predict;

interface PredictProps {
  context: RunContext;
  result: RunResult;
}

export function PredictPart(props: PredictProps) {
  const postures = usePostures(props.context.set, props.context.robot);
  return postures ? <Form {...props} postures={postures} /> : <Busy />;
}

/** A prediction with the posture and the load that it is about, R0, SI. */
interface Predicted {
  posture: Posture;
  point: Vector;
  force: Vector;
  answer: DeflectionResult;
}

const rounded = (values: readonly number[], digits: number): number[] =>
  values.map((value) => Number(value.toFixed(digits)));

/** A case in degrees, mm and N. */
interface Case extends Fields {
  joints: number[];
  force: Vector;
  load_point: Vector;
}

function Form({ context: { run, set, robot }, result, postures }: PredictProps & { postures: Posture[] }) {
  const unit = factors(set.units);
  const kinds = robot.joints.map(({ kind }) => kind);
  const point = (set.load_point ?? set.observations[0]?.load_point ?? [0, 0, 0]) as Vector;
  const measured = (i: number): Partial<Case> => {
    const [observation, posture] = [set.observations[i], postures[i]];
    if (!observation || !posture) return {};
    const shown = (value: number, j: number) =>
      position(value * (kinds[j] === "prismatic" ? unit.length : unit.angle), kinds[j]);
    const force = rounded(loadOf(set, observation, posture).force, 1) as unknown as Vector;
    return { joints: rounded(observation.joints.map(shown), 3), force };
  };
  const [chosen, setChosen] = useState("0");
  const [asked, setAsked] = useState<Fields>({
    load_point: rounded(times(point, 1e3 * unit.length), 3),
    ...measured(0),
  });
  const [found, setFound] = useState<Predicted | null>(null);
  const predict = useAction(async () => {
    const { joints, force, load_point: place } = asked as Case;
    const units = { length: "mm", angle: "deg", force: "N" };
    const answer = await api.predict({ run_id: run.id, units, cases: [asked] });
    const angles = joints.map((shown, j) => positionIn(shown, kinds[j]));
    const [posture] = (await api.kinematics({ robot_id: robot.id }, [angles])).postures;
    if (!posture) return;
    const inBase = fromFlange(posture.flange_origin, posture.flange_axes, times(place, 1e-3));
    setFound({ posture, point: inBase, force, answer });
  });
  const { deg, newton, mm } = text.units;
  const ofJoints = kinds.includes("prismatic") ? kinds.map((kind) => positionUnit(kind).trim()).join(", ") : deg;
  return (
    <div class="flow">
      <section class="card form">
        <h2>{words.title}</h2>
        <Select
          label={words.posture}
          value={chosen}
          change={(value) => {
            setChosen(value);
            setAsked({ ...asked, ...measured(Number(value)) });
          }}
          options={set.observations.map(({ label }, i) => ({ value: String(i), label }))}
        />
        <SchemaFields
          of="LoadCase"
          show={["joints", "force", "load_point"]}
          value={asked}
          change={setAsked}
          terms={{ labels: words.labels, units: { joints: [ofJoints, 1], force: [newton, 1], load_point: [mm, 1] } }}
        />
        <ActionButton
          look="primary"
          action={predict}
          disabled={unreadIn(asked) !== null || !asked["joints"] || !asked["force"] || !asked["load_point"]}
        >
          {text.run.views.predict}
        </ActionButton>
      </section>
      {found && (
        <section class="card" aria-live="polite">
          <Bent found={found} result={result} />
          <Answer answer={found.answer} />
        </section>
      )}
    </div>
  );
}

function Bent({ found: { posture, point, force, answer }, result }: { found: Predicted; result: RunResult }) {
  const displacement = (answer.cases[0]?.displacement ?? [0, 0, 0]) as Vector;
  const room = useMemo(() => roomOf([posture]), [posture]);
  const show = useMemo(() => {
    const reach = Math.max(0.2, ...room.map(norm));
    const factor = roundStep((0.14 * reach) / Math.max(1e-9, norm(displacement)), 1);
    const compliances = result.joints.map((joint) => joint.compliance);
    return {
      posture,
      ...ARM_ALONE,
      axes: false,
      predicted: [{ from: point, along: displacement }],
      load: norm(force) > 0 ? { from: point, along: force } : null,
      factor,
      bend: bendOf(posture, compliances, { point, force }),
    };
  }, [posture, answer]);
  const tip = add(point, times(displacement, show.factor));
  const [bends, setBends] = useState(0);
  return (
    <>
      <ArmView show={show} room={[...room, point, tip]} label={words.view} bends={bends} />
      <Button onClick={() => setBends((count) => count + 1)}>{text.scene.bend}</Button>
    </>
  );
}

export function Answer({ answer: { assessment, cases, confidence, remarks } }: { answer: DeflectionResult }) {
  const [found] = cases;
  if (!found) return null;
  const level = percent(confidence);
  const { micrometre } = text.units;
  const um = (value: number, u: number) => fixed(value * 1e6, Math.max(0, decimalsFor(u * 1e6)));
  const micro = (length: number) => `${significant(length * 1e6, 2)} ${micrometre}`;
  const { displacement, readings_only: readings, with_model_error: model, budget } = found;
  const factor = significant(budget?.coverage_factor ?? 0, 3);
  const size = norm(displacement ?? [0, 0, 0]);
  const length = budget ? um(size, budget.expanded_uncertainty) : significant(size * 1e6, 3);
  return (
    <>
      {(assessment.headline ?? assessment.verdict !== "use") && <VerdictCard assessment={assessment} context={null} />}
      {displacement && (
        <Facts
          facts={[
            { label: later.map.deflection, value: <b>{`${length} ${micrometre}`}</b> },
            ...(budget
              ? [{ label: words.expanded(level, factor), value: `± ${micro(budget.expanded_uncertainty)}` }]
              : []),
            ...(budget && model
              ? [
                  {
                    label: words.expandedWithModel(level, factor),
                    value: `± ${micro(budget.expanded_with_model_error)}`,
                  },
                ]
              : []),
            ...(!budget && model ? [{ label: words.modelAlone(level), value: micro(model.radius) }] : []),
            ...(readings?.displacement ?? []).map(([low, high], i) => ({
              label: words.along("xyz"[i] ?? "", level),
              value: `${um(low, (high - low) / 4)} … ${um(high, (high - low) / 4)}\u00a0${micrometre}`,
            })),
          ]}
        />
      )}
      {[...found.remarks, ...remarks].map((remark) => (
        <p class="note warn">
          <Prose text={sentence(remark)} />
        </p>
      ))}
    </>
  );
}
