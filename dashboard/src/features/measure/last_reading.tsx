/** The residuals of the last reading of a live campaign, as arrows at its targets. */
import type { LiveState, OpenSet, Robot } from "../../api/types";
import { Legend } from "../../charts/figure";
import { fixed, significant } from "../../lib/format";
import { standOf } from "../../lib/observation";
import { factors } from "../../lib/stiffness";
import { add, loadOf, norm, placesOf, times } from "../../lib/vector";
import { ArmView, roomOf } from "../../scene/view";
import { useKinematics } from "../../state/kinematics";
import { text } from "../../words";
import { magnification } from "../run/arrows";
import { measureWords } from "./words";

const words = measureWords.residuals;
/** Of a coordinate where the set states no noise [m]. */
const USUAL = 2e-5;
/** Noise of a good reading stays below this multiple of sigma: the 99.9 % quantile of √2 χ₃. */
const FARTHEST = 5.7;

/** By how much these few arrows are longer than those of a whole set. */
const LONGER = 2;
/** The room of the drawing, next to that of the arm: its labels are to be read. */
const WITH_LABELS = 1.2;

interface Props {
  set: OpenSet;
  robot: Robot;
  state: LiveState;
}

export function LastResiduals({ set, robot, state: { residuals } }: Props) {
  const label = residuals[0]?.observation;
  const observation = set.observations.find((one) => one.label === label);
  const kinds = robot.joints.map(({ kind }) => kind);
  const joints = observation ? standOf(observation, set.units, kinds).joints : null;
  const { kinematics } = useKinematics(joints ? { robot_id: robot.id } : null, joints ? [joints] : []);
  const posture = kinematics?.[0];
  if (!observation || !posture) return null;
  const places = placesOf(set, observation, posture);
  const found = residuals.filter(({ target }) => places.has(target));
  const arrows = found.map(({ target, residual }) => ({
    from: places.get(target) ?? posture.flange_origin,
    along: residual,
  }));
  const lengths = found.map(({ residual }) => norm(residual));
  const drawn = { measured: arrows, predicted: [], residuals: lengths, targets: found.map(({ target }) => target) };
  const factor = LONGER * magnification([drawn], roomOf([posture]));
  const sigma = set.noise?.sigma ? set.noise.sigma * factors(set.units).length : (set.open.sigma ?? USUAL);
  const worst = Math.max(FARTHEST * sigma, ...lengths);
  const { point, force } = loadOf(set, observation, posture);
  const tips = arrows.map(({ from, along }) => add(from, times(along, factor)));
  return (
    <>
      <ArmView
        posture={posture}
        {...drawn}
        load={norm(force) > 0 ? { from: point, along: force } : null}
        factor={factor}
        names={robot.joints.map(() => "")} // of the targets alone
        byResidual={worst}
        room={[...roomOf([posture]), ...tips].flatMap((place) => [place, times(place, WITH_LABELS)])}
        label={words.drawn(observation.label)}
      />
      <Legend
        items={[
          { mark: "ramp", label: words.ramp(`${significant(worst * 1e3, 2)} ${text.units.mm}`) },
          { mark: "load", label: text.files.facts.load },
        ]}
      />
      <p class="soft">
        {words.drawnLonger(fixed(factor, 0), `${significant(Math.max(...lengths) * 1e3, 2)} ${text.units.mm}`)}
      </p>
    </>
  );
}
