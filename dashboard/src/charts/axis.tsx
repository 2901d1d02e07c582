/** Axes: lines across the chart at round numbers, the numbers, and the unit at the end. */
import type { Scale } from "../lib/scale";

export function BottomAxis({
  scale,
  top,
  bottom,
  format,
  unit,
  right,
}: {
  scale: Scale;
  top: number;
  bottom: number;
  format: (value: number) => string;
  unit: string;
  right: number;
}) {
  return (
    <g class="axis">
      {scale.ticks.map((tick) => (
        <g>
          <line x1={scale(tick)} x2={scale(tick)} y1={top} y2={bottom} />
          <text x={scale(tick)} y={bottom + 20} text-anchor="middle">
            {format(tick)}
          </text>
        </g>
      ))}
      <text class="unit" x={right} y={bottom + 42} text-anchor="end">
        {unit}
      </text>
    </g>
  );
}

export function LeftAxis({
  scale,
  left,
  right,
  format,
  unit,
}: {
  scale: Scale;
  left: number;
  right: number;
  format: (value: number) => string;
  unit: string;
}) {
  return (
    <g class="axis">
      {scale.ticks.map((tick) => (
        <g>
          <line x1={left} x2={right} y1={scale(tick)} y2={scale(tick)} class={tick === 0 ? "zero" : undefined} />
          <text x={left - 8} y={scale(tick) + 5} text-anchor="end">
            {format(tick)}
          </text>
        </g>
      ))}
      <text class="unit" x={4} y={15}>
        {unit}
      </text>
    </g>
  );
}

/** Names along the bottom, thinned out until they fit. */
export function Names({
  names,
  place,
  bottom,
  room,
}: {
  names: string[];
  place: (index: number) => number;
  bottom: number;
  room: number;
}) {
  const every = Math.max(1, Math.ceil((names.length * 44) / Math.max(1, room)));
  return (
    <g class="axis">
      {names.map(
        (name, i) =>
          i % every === 0 && (
            <text x={place(i)} y={bottom + 20} text-anchor="middle">
              {name.length > 5 ? `${name.slice(0, 4)}…` : name}
            </text>
          ),
      )}
    </g>
  );
}
