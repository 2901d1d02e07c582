/** The 3D view as a part of the page; the drawing code is loaded when it is first needed. */
import { extent } from "../lib/scale";
import { type Vector, add, times } from "../lib/vector";
import { text } from "../i18n";
import type { Show } from "./show";
import { useEffect, useRef, useState } from "preact/hooks";
import type { Posture } from "../api/types";
import { Busy } from "../components/basics";
import type { Stage } from "./stage";

interface ArmViewProps {
  show: Show;
  /** What the view must hold, all the time. */
  room: Vector[];
  label: string;
  /** Counts up to look from the first side again. */
  resets?: number;
  /** Counts up to show the bend. */
  bends?: number;
}

export function ArmView({ show, room, label, resets = 0, bends = 0 }: ArmViewProps) {
  const canvas = useRef<HTMLCanvasElement>(null);
  const [stage, setStage] = useState<Stage | "none" | null>(null);
  useEffect(() => {
    let made: Stage | null = null;
    let gone = false;
    void import("./stage").then(({ Stage: Make }) => {
      if (gone || !canvas.current) return;
      try {
        made = new Make(canvas.current);
        setStage(made);
      } catch {
        setStage("none");
      }
    });
    return () => {
      gone = true;
      made?.dispose();
    };
  }, []);
  const drawing = stage === "none" ? null : stage;
  useEffect(() => drawing?.room(room), [drawing, room]);
  useEffect(() => drawing?.show(show), [drawing, show]);
  useEffect(() => {
    if (resets > 0) drawing?.reset();
  }, [resets]);
  useEffect(() => {
    if (bends > 0) drawing?.bend();
  }, [bends]);
  if (stage === "none") return <Sketch show={show} room={room} label={label} />;
  return (
    <div class="stage">
      {stage === null && <Busy label={text.scene.loading} />}
      <canvas ref={canvas} tabIndex={0} role="img" aria-label={label} data-ready={stage !== null} />
    </div>
  );
}

/** Points that a room must hold for these postures. */
export function roomOf(postures: Posture[]): Vector[] {
  return postures.flatMap((posture) => [...posture.joint_origins, posture.flange_origin]);
}

const SIZE = 320;

/** The arm from the side and from above, for devices without 3D graphics. */
function Sketch({ show, room, label }: { show: Show; room: Vector[]; label: string }) {
  return (
    <div class="stage sketches">
      <p>{text.scene.noWebgl}</p>
      <Plane show={show} room={room} u={0} v={2} label={`${label} ${text.scene.side}`} />
      <Plane show={show} room={room} u={0} v={1} label={`${label} ${text.scene.top}`} />
    </div>
  );
}

function Plane({ show, room, u, v, label }: { show: Show; room: Vector[]; u: 0 | 1; v: 1 | 2; label: string }) {
  const across = extent([0, ...room.map((p) => p[u])]) ?? [0, 1];
  const up = extent([0, ...room.map((p) => p[v])]) ?? [0, 1];
  const scale = (SIZE - 60) / Math.max(across[1] - across[0], up[1] - up[0], 0.1);
  const at = (p: Vector): string => `${30 + (p[u] - across[0]) * scale} ${SIZE - 30 - (p[v] - up[0]) * scale}`;
  const { posture } = show;
  const line = [[0, 0, 0] as Vector, ...posture.joint_origins, posture.flange_origin]
    .map((p, i) => `${i ? "L" : "M"}${at(p)}`)
    .join("");
  const arrow = (from: Vector, along: Vector) => `M${at(from)}L${at(add(from, times(along, show.factor)))}`;
  return (
    <svg class="sketch" role="img" aria-label={label} viewBox={`0 0 ${SIZE} ${SIZE}`}>
      <path class="link" d={line} />
      {posture.joint_origins.map((p) => (
        <circle cx={at(p).split(" ")[0]} cy={at(p).split(" ")[1]} r={6} />
      ))}
      {show.measured.map((a) => (
        <path class="measured" d={arrow(a.from, a.along)} />
      ))}
      {show.predicted.map((a) => (
        <path class="predicted" d={arrow(a.from, a.along)} />
      ))}
    </svg>
  );
}
