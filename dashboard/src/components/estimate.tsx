/** The one way in which views show an estimate: number, interval and relative width; grey where it must not be used. */
import { GOAL, rangeText, type ShownEstimate, widthText } from "../lib/estimate";

interface EstimateProps {
  of: ShownEstimate;
  /** Behind the number, where no heading has it. */
  unit?: string;
  /** Greatest relative half-width that is narrow enough. */
  goal?: number | null;
}

/** The number, or the limit in its place; its interval stands elsewhere in the row. */
export function EstimateValue({ of: { value, limit, unusable }, unit }: EstimateProps) {
  const shown = limit ?? value ?? "–";
  const Tag = unusable ? "span" : "b";
  return (
    <span class={unusable ? "estimate unusable" : "estimate"}>
      <Tag>{shown}</Tag>
      {unit && (limit ?? value) !== null && <small class="soft"> {unit}</small>}
    </span>
  );
}

/** The interval, in a place of its own; in two lines at most. */
export const EstimateInterval = ({ of: { interval, limit, unusable } }: EstimateProps) => (
  <span class={unusable ? "interval-of unusable" : "interval-of"}>
    {limit !== null || interval === null ? "–" : interval.replace(/(?<!…) /g, "\u00a0")}
  </span>
);

/** Size of a bar, and how many times the goal it reaches to each side of its middle. */
const [WIDTH, HEIGHT, REACH] = [44, 12, 2];

/** Whether there is a width to draw. */
export const hasBar = ({ limit, relative }: ShownEstimate): boolean => limit !== null || relative !== null;

/** The relative width as a bar around its middle, between two lines where the goal is; open above for a lower limit. */
export function EstimateBar({ of: { limit, relative, unusable }, goal }: EstimateProps) {
  const most = goal ?? GOAL;
  const sizeOf = (width: number) => (WIDTH / 2) * Math.min(1, width / (REACH * most));
  const half = relative === null ? WIDTH / 2 : Math.max(1, sizeOf(relative));
  const [from, to] = limit === null ? [WIDTH / 2 - half, WIDTH / 2 + half] : [WIDTH / 2, WIDTH];
  const isOpen = limit !== null || relative === null;
  const look = unusable ? "grey" : isOpen ? "open" : relative > most ? "beyond" : "narrow";
  return (
    <svg
      class={`estimate-bar ${look}`}
      viewBox={`0 0 ${WIDTH} ${HEIGHT}`}
      preserveAspectRatio="none"
      aria-hidden="true"
    >
      <rect x={from} width={to - from} y={3} height={HEIGHT - 6} />
      {[-1, 1].map((side) => {
        const x = WIDTH / 2 + side * sizeOf(most);
        return <line x1={x} x2={x} y1={0} y2={HEIGHT} />;
      })}
    </svg>
  );
}

interface WholeProps extends EstimateProps {
  /** The width in per cent in place of the interval, where there is little room. */
  brief?: boolean;
  /** Whether the bar stands elsewhere in the row. */
  bare?: boolean;
}

/** A number and its interval, with the bar of its relative width. */
export function Estimate({ of, unit, goal = null, brief = false, bare = false }: WholeProps) {
  const isNumber = of.limit === null && of.value !== null;
  const width = of.relative === null ? null : widthText(of.relative);
  const range = brief ? width : rangeText(of.interval);
  return (
    <span class="with-range" title={width ?? undefined}>
      <EstimateValue of={of} {...(unit === undefined ? {} : { unit })} />
      {!bare && hasBar(of) && <EstimateBar of={of} goal={goal} />}
      {isNumber && range && <small class="soft range"> {range}</small>}
    </span>
  );
}
