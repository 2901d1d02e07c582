/** Residuals by configuration, with the band in which most should lie. */
import { extent } from "../lib/scale";
import { ByName, type Opening } from "./bars";

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
          {dots.map((dot) => (
            <circle
              class={`dot ${dot.mark}`}
              cx={place(dot.column) + shift(dot.mark) * Math.min(5, step / 4)}
              cy={y(dot.value)}
              r={Math.min(3.6, Math.max(1.5, step / 5))}
            />
          ))}
        </>
      )}
    </ByName>
  );
}

const shift = (mark: string): number => (mark === "x" ? -1 : mark === "z" ? 1 : 0);
