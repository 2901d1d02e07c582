/** The arm from the side and from above, for devices without 3D graphics. */
import { extent } from "../lib/scale";
import { add, times, type Vector } from "../lib/vector";
import { text } from "../i18n";
import type { Show } from "./show";

const SIZE = 320;

export function Sketch({ show, room, label }: { show: Show; room: Vector[]; label: string }) {
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
