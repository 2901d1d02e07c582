/** Residuals by configuration, with the band in which most should lie. */
import { extent, linear } from "../lib/scale";
import { LeftAxis, Names } from "./axis";
import { axisFormat, Columns, type Opening } from "./bars";
import { Chart } from "./figure";

interface Dot {
  column: number;
  value: number;
  mark: string;
  title: string;
}

export function Scatter({
  names,
  dots,
  band,
  width,
  height = 280,
  label,
  unit,
  open,
  at,
}: {
  names: string[];
  dots: Dot[];
  /** Half width of the band, or null. */
  band: number | null;
  width: number;
  height?: number;
  label: string;
  unit: string;
} & Opening) {
  const [left, right, bottom] = [56, width - 8, height - 34];
  const reach = Math.max(...(extent(dots.map((dot) => dot.value)) ?? [0, 1]).map(Math.abs), band ?? 0) || 1;
  const y = linear(-reach, reach, bottom, 28);
  const step = (right - left) / Math.max(1, names.length);
  const place = (i: number) => left + (i + 0.5) * step;
  return (
    <Chart width={width} height={height} label={label}>
      {band !== null && <rect class="band" x={left} width={right - left} y={y(band)} height={y(-band) - y(band)} />}
      <LeftAxis scale={y} left={left} right={right} format={axisFormat(y.ticks)} unit={unit} />
      {dots.map((dot) => (
        <circle
          class={`dot ${dot.mark}`}
          cx={place(dot.column) + shift(dot.mark) * Math.min(5, step / 4)}
          cy={y(dot.value)}
          r={Math.min(3.6, Math.max(1.5, step / 5))}
        />
      ))}
      <Names names={names} place={place} bottom={bottom} room={right - left} />
      <Columns
        names={names}
        place={place}
        step={step}
        bottom={bottom}
        {...(open ? { open } : {})}
        {...(at === undefined ? {} : { at })}
        lines={(i) => dots.filter((dot) => dot.column === i).map((dot) => dot.title)}
      />
    </Chart>
  );
}

const shift = (mark: string): number => (mark === "x" ? -1 : mark === "z" ? 1 : 0);
