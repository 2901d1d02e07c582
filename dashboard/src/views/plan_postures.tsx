/** The postures of a plan: each with its angles, its load, and the arm drawn in it. */
import { useMemo, useState } from "preact/hooks";
import { api } from "../api/client";
import type { JointKind, Plan, PlanResult, Robot } from "../api/types";
import { Busy, Button } from "../components/basics";
import { fixed } from "../lib/format";
import type { Planned } from "../lib/planned";
import { position, positionUnit } from "../lib/units";
import { type Vector, norm } from "../lib/vector";
import { ARM_ALONE } from "../scene/show";
import { ArmView, roomOf } from "../scene/view";
import { useCached, valueOf } from "../state/load";
import { text } from "../i18n";
import { later } from "../i18n/later";
import { alongText } from "./next_measurement";

const words = later.plan;

export function Postures({ plan, result, robot }: { plan: Plan; result: PlanResult; robot: Robot }) {
  const [chosen, choose] = useState(0);
  const { readings } = result;
  const shown = readings[chosen];
  const drawn = valueOf(
    useCached(
      `plan/${plan.id}`,
      async () =>
        (
          await api.kinematics(
            { robot_id: robot.id },
            readings.map(({ joints }) => joints),
          )
        ).postures,
      Number.POSITIVE_INFINITY,
    ),
  );
  const posture = drawn?.[chosen];
  const room = useMemo(() => roomOf(drawn ?? []), [drawn]);
  const show = useMemo(
    () =>
      posture &&
      shown && {
        posture,
        ...ARM_ALONE,
        load: { from: posture.flange_origin as Vector, along: shown.force as Vector },
        names: robot.joints.map(({ name }) => name),
      },
    [posture, shown],
  );
  return (
    <div class="flow">
      <section class="card" aria-labelledby="postures">
        <h2 id="postures">{words.postures}</h2>
        {plan.request.measurement_set_id && <p class="soft">{words.newAlone}</p>}
        <ol class="postures">
          {readings.map((each, i) => (
            <li class={i === chosen ? "shown" : undefined}>
              <b>{each.label}</b>
              <Button look="quiet" onClick={() => choose(i)}>
                <span class="hidden">{words.show(each.label)}: </span>
                {angles(each, robot)}
              </Button>
            </li>
          ))}
        </ol>
      </section>
      {shown && (
        <section class="card sticky" aria-labelledby="current">
          <h2 id="current">{words.posture(shown.label)}</h2>
          {show ? (
            <ArmView show={show} room={room} label={words.drawn(shown.label)} />
          ) : (
            <Busy label={text.scene.loading} />
          )}
          <p class="angles">
            {shown.joints.map((angle, i) => (
              <span>
                <small class="soft">{robot.joints[i]?.name}</small> <b>{shownJoint(angle, robot.joints[i]?.kind, 1)}</b>
              </span>
            ))}
          </p>
          <p>
            {text.next.load(loadOf(shown))}
            {shown.direction && `; ${words.readAlong(shown.direction.map((part) => fixed(part, 2)).join(", "))}`}
            {shown.validation && <span class="soft"> ({words.heldOut})</span>}
          </p>
        </section>
      )}
    </div>
  );
}

export const shownJoint = (value: number, kind: JointKind | undefined, decimals: number): string =>
  `${fixed(position(value, kind), decimals)}${positionUnit(kind)}`;

const angles = ({ joints }: Planned, robot: Robot): string =>
  joints.map((value, i) => shownJoint(value, robot.joints[i]?.kind, 0)).join("  ");

export function loadOf({ force, anchor }: { force: readonly number[]; anchor: number | null }): string {
  const size = norm(force as unknown as Vector) || 1;
  const how = anchor === null ? alongText(force as unknown as Vector) : words.anchor(anchor + 1);
  return `${fixed(size, 0)} ${text.units.newton} ${how}`;
}
