/** The 3D view as a part of the page: what it shows, and the arm with its sliders; the drawing code is loaded when it is first needed. */
import type { Posture, RobotSource } from "../api/types";
import type { Box } from "../lib/box";
import type { Vector } from "../lib/vector";
import type { Show } from "./show";
import { text } from "../words";
import { useEffect, useLayoutEffect, useRef, useState, useMemo } from "preact/hooks";
import { Busy, Button, ProblemNote } from "../components/basics";
import { Handle } from "../components/fields";
import { PostureSketch } from "../components/posture";
import { leave, subject, take } from "./lasting";
import type { Stage } from "./stage";
import { fixed } from "../lib/format";
import { position, positionIn, positionUnit } from "../lib/stiffness";
import { useKinematics } from "../state/kinematics";
import { sceneWords } from "./words";
import { jointWords } from "../components/words";

/** What a view without a result shows: the arm alone. */
const ARM_ALONE = {
  measured: [],
  predicted: [],
  load: null,
  factor: 1,
  axes: true,
  names: [],
  targets: [],
  residuals: [],
  byResidual: null,
  bend: [],
  shares: [],
  chosen: null,
} satisfies Omit<Show, "posture">;

interface ArmViewProps extends Partial<Omit<Show, "posture">> {
  /** None while it is not there yet: the picture of the view before stays. */
  posture: Posture | null | undefined;
  /** What the view must hold, all the time. */
  room: Vector[];
  /** The room alone is looked at, without the foot of the arm. */
  near?: boolean;
  label: string;
  /** Counts up to look from the first side again. */
  resets?: number;
  /** Counts up to show the bend. */
  bends?: number;
  /** The box was dragged. */
  dragged?: (box: Box) => void;
  /** The force was pulled [N]. */
  pulled?: (force: Vector) => void;
}

/** The arm in a posture, with what is drawn beside it, in the drawing that all views share. */
export function ArmView({
  posture,
  room,
  near = false,
  label,
  resets = 0,
  bends = 0,
  dragged,
  pulled,
  ...drawn
}: ArmViewProps) {
  const hears = useRef({ dragged, pulled });
  hears.current = { dragged, pulled };
  const show: Show | null = posture ? { ...ARM_ALONE, ...drawn, posture } : null;
  const view = useRef<HTMLDivElement>(null);
  const [stage, setStage] = useState<Stage | "none" | null>(null);
  /** Whether there is a picture, if only that of the view before. */
  const [pictured, setPictured] = useState(false);
  useLayoutEffect(() => {
    const of = subject();
    let own: Stage | null = null;
    let gone = false;
    const enter = (entered: Stage) => {
      own = entered;
      setStage(entered);
    };
    const left = take();
    if (left && view.current) {
      left.stage.enter(view.current, left.of !== of);
      setPictured(left.of === of);
      enter(left.stage);
    } else
      void import("./stage").then(({ Stage: Make }) => {
        if (gone || !view.current) return;
        try {
          enter(new Make(view.current));
        } catch {
          setStage("none");
        }
      });
    return () => {
      gone = true;
      if (own) leave(own, of);
    };
  }, []);
  const drawing = stage === "none" ? null : stage;
  useEffect(() => {
    drawing?.listen(label, {
      dragged: (box) => hears.current.dragged?.(box),
      pulled: (force) => hears.current.pulled?.(force),
    });
  }, [drawing, label]);
  const shown = JSON.stringify(show);
  useEffect(() => {
    if (show) drawing?.room(room, near);
  }, [drawing, near, JSON.stringify(room), show === null]);
  useEffect(() => {
    if (!drawing || !show) return;
    drawing.show(show);
    setPictured(true);
  }, [drawing, shown]);
  useEffect(() => {
    if (resets > 0) drawing?.reset();
  }, [resets]);
  useEffect(() => {
    if (bends > 0) drawing?.bend();
  }, [bends]);
  if (stage === "none" && show)
    return (
      <div class="stage sketched">
        <p class="soft">{sceneWords.noWebgl}</p>
        <PostureSketch posture={show.posture} force={show.load?.along ?? null} size={[320, 260]} label={label} />
      </div>
    );
  return (
    <div class="stage" ref={view}>
      {!pictured && <Busy label={sceneWords.loading} />}
    </div>
  );
}

/** Points that a room must hold for these postures. */
export function roomOf(postures: Posture[]): Vector[] {
  return postures.flatMap((posture) => [...posture.joint_origins, posture.flange_origin]);
}

/** Most that a slider moves a joint: half a turn, or 2 m [mm]. */
const MOST = { revolute: 180, prismatic: 2000 } as const;

const TURNED: number[] = [-0.9, 0.8];

interface ArmProps {
  /** Null: the arm stands here once there is one. */
  source: RobotSource | null;
  start: number[] | null;
  sliders?: boolean;
}

/** `start`: joints of the first look, rad or m. */
export function Arm({ source, start, sliders = true }: ArmProps) {
  const [angles, setAngles] = useState<number[] | null>(start);
  const startKey = JSON.stringify(start);
  useEffect(() => setAngles(start), [startKey]);
  const { kinematics, problem } = useKinematics(source, angles ? [angles] : []);
  const posture = kinematics?.[0];
  const names = posture?.joint_names ?? [];
  const room = useMemo(() => {
    // a sphere that the arm does not leave, so that the view stays still while it moves
    const points = posture ? roomOf([posture]) : [];
    const reach = Math.max(0.3, ...points.map((p) => Math.hypot(...p)));
    return [...points, ...TURNED.map((f) => [f * reach, f * reach * 0.6, 0] as const)];
  }, [JSON.stringify(source), startKey, posture === undefined]);
  const current = names.map((_, i) => angles?.[i] ?? 0);
  if (!source) return <p class="stage blank">{text.start.armHere}</p>;
  return (
    <div class="arm">
      {problem && <ProblemNote problem={problem} />}
      {(posture || !problem) && <ArmView {...{ posture, names, room }} label={sceneWords.canvasPlain} />}
      {posture && sliders && (
        <details class="sliders">
          <summary>{jointWords.sliders}</summary>
          {posture.joint_kinds.map((kind, i) => {
            const shown = `${fixed(position(current[i] ?? 0, kind), 0)}${positionUnit(kind)}`;
            return (
              <Handle
                look="slider"
                label={jointWords.angle(names[i] ?? "")}
                said={shown}
                from={-MOST[kind]}
                count={2 * MOST[kind] + 1}
                value={Math.round(position(current[i] ?? 0, kind))}
                change={(to) => setAngles(current.map((old, j) => (j === i ? positionIn(to, kind) : old)))}
              >
                <bdi>{names[i]}</bdi> <b>{shown}</b>
              </Handle>
            );
          })}
          <Button onClick={() => setAngles(names.map(() => 0))}>{jointWords.zero}</Button>
        </details>
      )}
    </div>
  );
}
