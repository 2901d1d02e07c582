/** The arm beside a result; the colour of a joint is what it contributes to the deflection of the configuration shown. */
import { useState } from "preact/hooks";
import type { MeasurementSet, RunResult } from "../../api/types";
import { RampLegend } from "../../charts/ramp";
import { Button, LinkButton, Name } from "../../components/basics";
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
import type { Chosen } from "./chosen";
import { armWords as words } from "./words";

interface RunArmProps {
  context: RunContext;
  result: RunResult;
  /** What was chosen. */
  chosen: Chosen;
  /** The part of the run's page that has this arm. */
  part: string;
}

export function RunArm({ context: { run, set, robot }, result, chosen: { joint, at }, part }: RunArmProps) {
  const shown = shownOf(set, result, { joint, at });
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
  const compliances = result.joints.map(({ compliance }) => compliance);
  const canBend = compliances.some((compliance) => compliance !== null && compliance !== 0);
  const names = result.joints.map(({ name }) => name);
  const chosen = joint === null ? -1 : names.indexOf(joint);
  const length = parts[chosen];
  return (
    <>
      <ArmView
        posture={posture}
        measured={arrows?.measured ?? []}
        predicted={arrows?.predicted ?? []}
        load={pulls ? { from: load.point, along: load.force } : null}
        factor={factor}
        axes={false}
        names={names}
        chosen={chosen < 0 ? null : chosen}
        shares={most > 0 ? parts.map((part) => part && part / most) : []}
        bend={posture && load ? bendOf(posture, compliances, load) : []}
        bends={bends}
        room={[...room, ...tips]}
        label={sceneWords.canvas(observation.label)}
      />
      <p>
        <b>{observation.label}</b> {words.deflects(significant(deflection * 1e3, 3))}
      </p>
      <p class="soft line">{load && words.drawn(pulls ? fixed(norm(load.force), 0) : null, factorText(factor))}</p>
      {joint !== null && chosen >= 0 && (
        <p role="status">
          <b>
            <Name>{joint}</Name>
          </b>{" "}
          {words.ofJoint(length ? significant(length * 1e3, 3) : null)}
        </p>
      )}
      {most > 0 && <RampLegend scale={[0, most * 1e3]} unit={text.units.mm} label={words.part} />}
      <div class="actions">
        {canBend && (
          <Button look="quiet" onClick={() => setBends((count) => count + 1)}>
            {sceneWords.bend}
          </Button>
        )}
        {result.assessment.verdict !== "do_not_use" && (
          <LinkButton look="quiet" href={link(["runs", run.id, "predict"])}>
            {words.pull}
          </LinkButton>
        )}
        {at !== null && (
          <LinkButton look="quiet" href={link(["runs", run.id, "robot"], { at: observation.label, from: part })}>
            {text.run.views.robot}
          </LinkButton>
        )}
      </div>
    </>
  );
}

/** An observation with the mean length of its deflections, and what each joint contributes to them, if known [m]. */
export function shownOf(set: MeasurementSet, result: RunResult, chosen: Chosen) {
  const rows = byObservation(result.residuals);
  const index = indexOf(rows, result, chosen);
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

/** A factor that shrinks, too: readings in mm for m deflect by metres. */
const factorText = (factor: number): string => (factor < 1 ? significant(factor, 1) : fixed(factor, 0));

/** The configuration that was chosen; else that to which the chosen joint contributes most, else that which deflects most. */
function indexOf(rows: { name: string; before: number }[], result: RunResult, { joint, at }: Chosen): number {
  const stated = rows.findIndex(({ name }) => name === at);
  if (stated >= 0) return stated;
  const lengths = result.contributions.find((one) => one.joint === joint)?.by_observation ?? [];
  const contributed = rows.map((_, i) => Math.abs(lengths[i] ?? 0));
  const isKnown = contributed.some((length) => length > 0);
  const compared = isKnown ? contributed : rows.map(({ before }) => before);
  return compared.indexOf(Math.max(...compared));
}
