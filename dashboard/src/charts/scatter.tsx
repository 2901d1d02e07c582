/** Residuals by configuration, with the band in which most should lie. */
import { extent } from "../lib/scale";
import { ByName, circle, type Opening } from "./bars";

interface Dot {
  column: number;
  value: number;
  mark: string;
  title: string;
}

export function Scatter({
  dots,
  band,
  ...frame
}: {
  names: string[];
  dots: Dot[];
  /** Half width of the band, or null. */
  band: number | null;
  width: number;
  label: string;
  unit: string;
} & Opening) {
  const reach = Math.max(...(extent(dots.map((dot) => dot.value)) ?? [0, 1]).map(Math.abs), band ?? 0) || 1;
  const lines = (i: number) => dots.filter((dot) => dot.column === i).map((dot) => dot.title);
  return (
    <ByName {...frame} height={280} range={[-reach, reach]} lines={lines}>
      {(place, step, y) => (
        <>
          {band !== null && (
            <rect
              class="band"
              x={place(-0.5)}
              width={step * frame.names.length}
              y={y(band)}
              height={y(-band) - y(band)}
            />
          )}
          {[...new Set(dots.map(({ mark }) => mark))].map((mark) => (
            <path
              class={`dot ${mark}`}
              d={dots
                .filter((dot) => dot.mark === mark)
                .map(({ column, value }) =>
                  circle(place(column) + shift(mark) * Math.min(5, step / 4), y(value), radius(step)),
                )
                .join("")}
            />
          ))}
        </>
      )}
    </ByName>
  );
}

const radius = (step: number): number => Math.min(3.6, Math.max(1.5, step / 5));
const shift = (mark: string): number => (mark === "x" ? -1 : mark === "z" ? 1 : 0);
