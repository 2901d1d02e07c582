/** The arm beside a result, in the configuration that deflects most; the colour of a joint is what it contributes. */
import { useState } from "preact/hooks";
import type { MeasurementSet, RunResult } from "../../api/types";
import { RampLegend } from "../../charts/ramp";
import { Button, LinkButton } from "../../components/basics";
import { fixed, significant } from "../../lib/format";
import { standOf } from "../../lib/observation";
import { add, bendOf, loadOf, norm, times } from "../../lib/vector";
import { ArmView, roomOf } from "../../scene/view";
import { sceneWords } from "../../scene/words";
import { link } from "../../state/action";
import { useKinematics } from "../../state/kinematics";
import type { RunContext } from "../../state/run_context";
import { text } from "../../words";
import { arrowsOf, byObservation, magnification } from "./arrows";
import { armWords as words } from "./words";

interface RunArmProps {
  context: RunContext;
  result: RunResult;
  /** The configuration that is looked at; none: that which deflects most. */
  at: string | null;
}

export function RunArm({ context: { run, set, robot }, result, at }: RunArmProps) {
  const shown = shownOf(set, result, at);
  const kinds = robot.joints.map(({ kind }) => kind);
  const joints = shown && standOf(shown.observation, set.units, kinds).joints;
  const posture = useKinematics(shown && { robot_id: robot.id }, joints ? [joints] : []).kinematics?.[0];
  const [bends, setBends] = useState(0);
  if (!shown) return null;
  const { observation, deflection, parts } = shown;
  const only = { ...set, observations: [observation] };
  const [arrows] = posture ? arrowsOf(only, [posture], result) : [];
  const load = posture ? loadOf(set, observation, posture) : null;
  const pulls = load !== null && norm(load.force) > 0;
  const room = posture ? roomOf([posture]) : [];
  const factor = arrows ? magnification([arrows], room) : 1;
  const tips = (arrows?.measured ?? []).map(({ from, along }) => add(from, times(along, factor)));
  const most = Math.max(0, ...parts.map((part) => part ?? 0));
  const compliances = result.joints.map((joint) => joint.compliance);
  return (
    <>
      <ArmView
        posture={posture}
        measured={arrows?.measured ?? []}
        predicted={arrows?.predicted ?? []}
        load={pulls ? { from: load.point, along: load.force } : null}
        factor={factor}
        axes={false}
        names={result.joints.map((joint) => joint.name)}
        shares={most > 0 ? parts.map((part) => part && part / most) : []}
        bend={posture && load ? bendOf(posture, compliances, load) : []}
        bends={bends}
        room={[...room, ...tips]}
        label={sceneWords.canvas(observation.label)}
      />
      <p>
        <b>{observation.label}</b> {words.deflects(significant(deflection * 1e3, 3))}
      </p>
      <p class="soft line">{load && words.drawn(pulls ? fixed(norm(load.force), 0) : null, fixed(factor, 0))}</p>
      {most > 0 && <RampLegend scale={[0, most * 1e3]} unit={text.units.mm} label={words.part} />}
      <div class="actions">
        <Button look="quiet" onClick={() => setBends((count) => count + 1)}>
          {sceneWords.bend}
        </Button>
        <LinkButton look="quiet" href={link(["runs", run.id, "predict"])}>
          {words.pull}
        </LinkButton>
      </div>
    </>
  );
}

/** An observation with the mean length of its deflections, and what each joint contributes to them, if known [m]. */
export function shownOf(set: MeasurementSet, result: RunResult, at: string | null) {
  const rows = byObservation(result.residuals);
  const greatest = Math.max(...rows.map(({ before }) => before));
  const isKnown = rows.some(({ name }) => name === at);
  const index = rows.findIndex(({ name, before }) => (isKnown ? name === at : before === greatest));
  const row = rows[index];
  const observation = set.observations.find(({ label }) => label === row?.name);
  if (!row || !observation) return null;
  const parts = result.joints.map(({ name, compliance }) => {
    const lengths = result.contributions.find(({ joint }) => joint === name)?.by_observation;
    const length = lengths?.[index];
    return compliance === null || length === undefined ? null : Math.abs(length);
  });
  return { observation, deflection: row.before, parts };
}
