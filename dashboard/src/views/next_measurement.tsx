/** What to measure next for a joint: the posture drawn, its angles to copy, the load, and what it would bring. */
import { useMemo } from "preact/hooks";
import { api } from "../api/client";
import type { Advice, JointResult, MeasurementSet, Posture, Robot, Run } from "../api/types";
import { PostureSketch } from "../components/posture";
import { fixed, percent, significant } from "../lib/format";
import { position, positionUnit } from "../lib/units";
import { norm, type Vector } from "../lib/vector";
import { useCached, valueOf } from "../state/load";
import { link } from "../state/router";
import { copied } from "../state/toasts";
import { text } from "../i18n";
import { Button, LinkButton } from "../components/basics";

const words = text.next;

interface Piece {
  advice: Advice;
  /** Null while it is on its way. */
  posture: Posture | null;
}

/** Pieces of advice with their postures. */
export function useAdvice(robot: Robot, advice: Advice[]): Piece[] {
  const joints = advice.map((one) => one.joints);
  const drawn = valueOf(
    useCached(
      `advice/${robot.id}/${JSON.stringify(joints)}`,
      async () => (joints.length > 0 ? (await api.kinematics({ robot_id: robot.id }, joints)).postures : []),
      Number.POSITIVE_INFINITY,
    ),
  );
  return useMemo(() => advice.map((one, i) => ({ advice: one, posture: drawn?.[i] ?? null })), [advice, drawn]);
}

export function NextMeasurement({
  pieces: [first, ...others],
  joint,
  run,
  set,
}: {
  pieces: Piece[];
  joint: JointResult;
  run: Run;
  set: MeasurementSet;
}) {
  if (!first) return null;
  return (
    <div role="row" class="next">
      <div role="cell">
        <One piece={first} joint={joint} run={run} set={set} />
        {others.length > 0 && (
          <details>
            <summary>{words.other}</summary>
            {others.map((piece) => (
              <One piece={piece} joint={joint} run={run} set={set} />
            ))}
          </details>
        )}
      </div>
    </div>
  );
}

function One({
  piece: { advice, posture },
  joint,
  run,
  set,
}: {
  piece: Piece;
  joint: JointResult;
  run: Run;
  set: MeasurementSet;
}) {
  const kinds = run.result?.joints.map(({ kind }) => kind) ?? [];
  const angles = advice.joints.map((value, i) => fixed(position(value, kinds[i]), 1));
  const copy = () => {
    const plain = angles.map((angle, i) => `A${i + 1} ${angle.replace("\u2212", "-")}`).join(", ");
    copied(plain, words.copy, words.copied);
  };
  return (
    <div class="piece">
      <PostureSketch posture={posture} force={advice.force as Vector} />
      <div>
        <p>
          <b>{words.title(joint.name)}</b>{" "}
          {advice.observation === null ? words.newPosture : words.posture(advice.observation)},{" "}
          {words.load(load(advice.force as Vector))}
        </p>
        <p class="angles">
          {angles.map((angle, i) => (
            <span>
              <small>A{i + 1}</small> {angle}
              {positionUnit(kinds[i])}
            </span>
          ))}
          <Button look="quiet" onClick={copy}>
            {words.copy}
          </Button>
          {advice.observation !== null && set.observations.some((one) => one.label === advice.observation) && (
            <LinkButton look="quiet" href={link(["runs", run.id, "robot"], { at: advice.observation })}>
              {words.show}
            </LinkButton>
          )}
        </p>
      </div>
      <p class="gain">
        <small class="soft">{words.gain}</small>
        <b>
          {before(joint)} → {afterwards(advice, joint)}
        </b>
      </p>
    </div>
  );
}

const load = (force: Vector): string => `${fixed(norm(force), 0)} ${text.units.newton} ${alongText(force)}`;

/** Where a force pulls, in words where it is a weight. */
export function alongText(force: Vector): string {
  const unit = force.map((part) => part / (norm(force) || 1));
  return (unit[2] ?? 0) < -0.9999 ? words.down : words.along(unit.map((part) => fixed(part, 2)).join(", "));
}

/** Standard uncertainty relative to the compliance. */
function before({ compliance, standard_uncertainty: u }: JointResult): string {
  return compliance === null || compliance <= 0 || u === null ? words.unknown : percent(u / compliance);
}

function afterwards(advice: Advice, { kind, compliance, standard_uncertainty: u }: JointResult): string {
  const { standard_uncertainty: after, uncertainty_ratio: ratio } = advice;
  if (compliance !== null && compliance > 0) {
    if (ratio !== null && u !== null) return percent((ratio * u) / compliance);
    if (after !== null) return percent(after / compliance);
  }
  const unit = kind === "prismatic" ? "nm/N" : "nrad/(N·m)";
  return after === null ? words.determined : `±\u00a0${significant(after * 1e9, 2)}\u00a0${unit}`;
}
