/** A small drawing of the arm in a posture, from a corner above, with the load on it. */
import type { Posture } from "../api/types";
import { extent } from "../lib/format";
import { add, norm, times, type Vector } from "../lib/vector";

const MARGIN = 12;
const [ACROSS, UP] = [Math.cos(Math.PI / 6), Math.sin(Math.PI / 6)];

/** Isometric: x to the lower left, y to the lower right, z up. */
const flat = ([x, y, z]: Vector): [number, number] => [(y - x) * ACROSS, (x + y) * UP - z];

interface PostureSketchProps {
  posture: Posture | null;
  force: Vector | null;
  size?: [number, number];
  label?: string;
}

export function PostureSketch({ posture, force, size: [width, height] = [132, 104], label }: PostureSketchProps) {
  if (!posture) return <span class="posture" aria-hidden="true" />;
  const chain: Vector[] = [[0, 0, 0], ...posture.joint_origins, posture.flange_origin];
  const reach = Math.max(0.2, ...chain.map(norm));
  const size = force && norm(force);
  const tip = force && size ? add(posture.flange_origin, times(force, (0.38 * reach) / size)) : null;
  const corners: Vector[] = [
    [-0.25 * reach, -0.25 * reach, 0],
    [0.25 * reach, -0.25 * reach, 0],
    [0.25 * reach, 0.25 * reach, 0],
    [-0.25 * reach, 0.25 * reach, 0],
  ];
  const all = [...chain, ...corners, ...(tip ? [tip] : [])].map(flat);
  const [left, right] = extent(all.map(([u]) => u)) ?? [0, 1];
  const [top, bottom] = extent(all.map(([, v]) => v)) ?? [0, 1];
  const scale = Math.min((width - 2 * MARGIN) / (right - left || 1), (height - 2 * MARGIN) / (bottom - top || 1));
  const at = (point: Vector): [number, number] => {
    const [u, v] = flat(point);
    return [width / 2 + (u - (left + right) / 2) * scale, height / 2 + (v - (top + bottom) / 2) * scale];
  };
  const path = (points: Vector[]) => points.map((point, i) => `${i ? "L" : "M"}${at(point).join(" ")}`).join("");
  return (
    <svg
      class="posture"
      width={width}
      height={height}
      viewBox={`0 0 ${width} ${height}`}
      role={label === undefined ? undefined : "img"}
      aria-label={label}
      aria-hidden={label === undefined}
    >
      <path class="floor" d={`${path(corners)}z`} />
      <path class="link" d={path(chain)} />
      {posture.joint_origins.map((origin) => {
        const [cx, cy] = at(origin);
        return <circle cx={cx} cy={cy} r={3.2} />;
      })}
      {tip && <Arrow from={at(posture.flange_origin)} to={at(tip)} />}
    </svg>
  );
}

function Arrow({ from: [x, y], to: [u, v] }: { from: [number, number]; to: [number, number] }) {
  const turn = (Math.atan2(v - y, u - x) * 180) / Math.PI;
  return (
    <>
      <line class="force" x1={x} y1={y} x2={u} y2={v} />
      <path class="force-head" d="M3 0 l-9 -4.5 v9 z" transform={`translate(${u} ${v}) rotate(${turn})`} />
    </>
  );
}
