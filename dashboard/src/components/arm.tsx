/** The arm with a slider for each joint: mistakes in the kinematics show at once. */
import { useEffect, useMemo, useState } from "preact/hooks";
import type { JointKind, RobotSource } from "../api/types";
import { fixed } from "../lib/format";
import { position, positionIn, positionUnit } from "../lib/units";
import { ArmView, roomOf } from "../scene/view";
import { ARM_ALONE } from "../scene/show";
import { useKinematics } from "../state/posture";
import { text } from "../i18n";
import { later } from "../i18n/later";
import { Busy, Button, ProblemNote } from "./basics";

const TURNED: number[] = [-0.9, 0.8];

/** `start`: joints of the first look, rad or m. */
export function Arm({
  source,
  start,
  sliders = true,
}: {
  source: RobotSource;
  start: number[] | null;
  sliders?: boolean;
}) {
  const [angles, setAngles] = useState<number[] | null>(start);
  const startKey = JSON.stringify(start);
  useEffect(() => setAngles(start), [startKey]);
  const { kinematics, problem } = useKinematics(source, angles ? [angles] : []);
  const names = kinematics?.joints ?? [];
  const posture = kinematics?.postures[0];
  const room = useMemo(() => {
    // a sphere that the arm does not leave, so that the view stays still while it moves
    const points = posture ? roomOf([posture]) : [];
    const reach = Math.max(0.3, ...points.map((p) => Math.hypot(...p)));
    return [...points, ...TURNED.map((f) => [f * reach, f * reach * 0.6, 0] as const)];
  }, [JSON.stringify(source), startKey, posture === undefined]);
  const show = useMemo(() => posture && { posture, ...ARM_ALONE, names }, [posture, names.join()]);
  const current = names.map((_, i) => angles?.[i] ?? 0);
  return (
    <div class="arm">
      {problem && <ProblemNote problem={problem} />}
      {!show && !problem && <Busy label={text.scene.loading} />}
      {show && <ArmView show={show} room={room} label={text.scene.canvasPlain} />}
      {show && sliders && (
        <details class="sliders">
          <summary>{later.robots.sliders}</summary>
          {names.map((name, i) => (
            <Slider
              name={name}
              kind={posture?.joint_kinds[i] ?? "revolute"}
              value={current[i] ?? 0}
              change={(value) => setAngles(current.map((old, j) => (j === i ? value : old)))}
            />
          ))}
          <Button onClick={() => setAngles(names.map(() => 0))}>{later.robots.zero}</Button>
        </details>
      )}
    </div>
  );
}

/** Most that a slider moves a joint: half a turn, or 2 m [mm]. */
const MOST = { revolute: 180, prismatic: 2000 } as const;

function Slider({
  name,
  kind,
  value,
  change,
}: {
  name: string;
  kind: JointKind;
  value: number;
  change: (value: number) => void;
}) {
  const shown = position(value, kind);
  return (
    <label class="slider">
      <bdi>{name}</bdi>
      <input
        type="range"
        min={-MOST[kind]}
        max={MOST[kind]}
        step={1}
        value={Math.round(shown)}
        aria-label={later.robots.angle(name)}
        onInput={(event) => change(positionIn(Number(event.currentTarget.value), kind))}
      />
      <output>
        {fixed(shown, 0)}
        {positionUnit(kind)}
      </output>
    </label>
  );
}
