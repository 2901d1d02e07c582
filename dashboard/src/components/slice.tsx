/** A slice through a map: a cell a place, coloured by its value; tap or arrow keys choose one. */
import { useMemo } from "preact/hooks";
import type { MapPlace, Slice } from "../lib/map";
import { fixed } from "../lib/format";
import { text } from "../i18n";

const AXES = ["x", "y", "z"] as const;
const MARGIN = { left: 46, bottom: 40, top: 8, right: 8 };
const HEIGHT = 440;

export function SliceChart({
  slice,
  places,
  values,
  scale,
  chosen,
  choose,
  width,
  label,
}: {
  slice: Slice;
  places: MapPlace[];
  values: number[];
  /** Values of both ends of the colours. */
  scale: readonly [number, number];
  chosen: number | null;
  choose: (place: number) => void;
  width: number;
  label: string;
}) {
  const { u, v, cells } = slice;
  const columns = cells[0]?.length ?? 1;
  const position = (index: number | undefined, axis: 0 | 1 | 2) => places[index ?? 0]?.position[axis] ?? 0;
  const spanU = position(cells[0]?.at(-1), u) - position(cells[0]?.[0], u);
  const spanV = position(cells[0]?.[0], v) - position(cells.at(-1)?.[0], v);
  const room = Math.max(60, width - MARGIN.left - MARGIN.right);
  const shape = Math.max(0.05, spanU > 0 && spanV > 0 ? spanV / spanU : cells.length / columns);
  const high = Math.min(HEIGHT, Math.max(24, room * shape));
  const wide = Math.min(room, high / shape);
  const [w, h] = [wide / columns, high / cells.length];
  const at = useMemo(() => {
    for (const [row, line] of cells.entries()) {
      const column = chosen === null ? -1 : line.indexOf(chosen);
      if (column >= 0) return [row, column] as const;
    }
    return null;
  }, [cells, chosen]);
  const pick = (row: number, column: number) => {
    const index = cells[Math.min(cells.length - 1, Math.max(0, row))]?.[Math.min(columns - 1, Math.max(0, column))];
    if (index !== undefined) choose(index);
  };
  const tap = (event: MouseEvent & { currentTarget: SVGSVGElement }) => {
    const box = event.currentTarget.getBoundingClientRect();
    const x = event.clientX - box.left - MARGIN.left;
    const y = event.clientY - box.top - MARGIN.top;
    if (x >= 0 && y >= 0 && x < wide && y < high) pick(Math.floor(y / h), Math.floor(x / w));
  };
  const key = (event: KeyboardEvent) => {
    const step = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [-1, 0], ArrowDown: [1, 0] }[event.key];
    if (!step) return;
    event.preventDefault();
    const [row, column] = at ?? [0, 0];
    pick(row + (step[0] ?? 0), column + (step[1] ?? 0));
  };
  const height = high + MARGIN.top + MARGIN.bottom;
  return (
    <svg
      class="chart slice"
      role="img"
      aria-label={label}
      tabIndex={0}
      width={width}
      height={height}
      viewBox={`0 0 ${width} ${height}`}
      onClick={tap}
      onKeyDown={key}
    >
      {cells.map((line, row) =>
        line.map((index, column) => (
          <rect
            x={MARGIN.left + column * w}
            y={MARGIN.top + row * h}
            width={w + 0.4}
            height={h + 0.4}
            class={Number.isFinite(values[index]) ? undefined : `none ${places[index]?.status}`}
            style={{ fill: rampFill(share(values[index], scale)) }}
          />
        )),
      )}
      {at && (
        <rect
          class="chosen"
          x={MARGIN.left + at[1] * w}
          y={MARGIN.top + at[0] * h}
          width={Math.max(w, 4)}
          height={Math.max(h, 4)}
        />
      )}
      <text class="tick" x={MARGIN.left} y={height - 22}>
        {fixed(1e3 * position(cells[0]?.[0], u), 0)}
      </text>
      <text class="tick" x={MARGIN.left + wide} y={height - 22} text-anchor="end">
        {fixed(1e3 * position(cells[0]?.at(-1), u), 0)}
      </text>
      <text class="tick" x={MARGIN.left + wide / 2} y={height - 6} text-anchor="middle">
        {AXES[u]} [{text.units.mm}]
      </text>
      <text class="tick" x={MARGIN.left - 6} y={MARGIN.top + 10} text-anchor="end">
        {fixed(1e3 * position(cells[0]?.[0], v), 0)}
      </text>
      <text class="tick" x={MARGIN.left - 6} y={MARGIN.top + high} text-anchor="end">
        {fixed(1e3 * position(cells.at(-1)?.[0], v), 0)}
      </text>
      <text class="tick" x={MARGIN.left - 6} y={MARGIN.top + high / 2 + 4} text-anchor="end">
        {AXES[v]}
      </text>
    </svg>
  );
}

/** Place of a value between the ends of a scale; NaN where there is none. */
export const share = (value: number | undefined, [low, high]: readonly [number, number]): number =>
  value === undefined ? Number.NaN : Math.min(1, Math.max(0, (value - low) / (high - low || 1)));

function rampFill(part: number): string | undefined {
  if (Number.isNaN(part)) return undefined;
  const [from, to, mix] = part < 0.5 ? ["--ramp-0", "--ramp-1", part * 2] : ["--ramp-1", "--ramp-2", part * 2 - 1];
  return `color-mix(in oklab, var(${to}) ${(mix * 100).toFixed(1)}%, var(${from}))`;
}

/** The colours with their ends in numbers. */
export function RampLegend({
  scale: [low, high],
  unit,
  label,
}: {
  scale: readonly [number, number];
  unit: string;
  label: string;
}) {
  const digits = Math.max(0, 2 - Math.floor(Math.log10(high || 1)));
  return (
    <p class="ramp-legend">
      <span>{label}</span>
      <span class="ends">
        {fixed(low, digits)}
        <i class="ramp-bar" aria-hidden="true" />
        {fixed(high, digits)} {unit}
      </span>
    </p>
  );
}
