/** The 3D view as a part of the page; the drawing code is loaded when it is first needed. */
import type { Vector } from "../lib/vector";
import { text } from "../i18n";
import type { Show } from "./show";
import { useEffect, useRef, useState } from "preact/hooks";
import type { Posture } from "../api/types";
import { Busy } from "../components/basics";
import { PostureSketch } from "../components/posture";
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
  if (stage === "none")
    return (
      <div class="stage sketched">
        <p class="soft">{text.scene.noWebgl}</p>
        <PostureSketch posture={show.posture} force={show.load?.along ?? null} size={[320, 260]} label={label} />
      </div>
    );
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
