/** The one way in which views show an estimate: the number and its interval, grey where it must not be used. */
import { rangeText, type ShownEstimate } from "../lib/estimate";

interface EstimateProps {
  of: ShownEstimate;
  /** Behind the number, where no heading has it. */
  unit?: string;
}

/** The number, or the limit in its place; its interval stands elsewhere in the row. */
export function EstimateValue({ of: { value, limit, unusable }, unit }: EstimateProps) {
  const shown = limit ?? value ?? "–";
  const Tag = unusable ? "span" : "b";
  return (
    <span class={unusable ? "estimate unusable" : "estimate"}>
      <Tag>{shown}</Tag>
      {unit && value !== null && <small class="soft"> {unit}</small>}
    </span>
  );
}

/** The interval, in a place of its own. */
export const EstimateInterval = ({ of: { interval, limit } }: EstimateProps) => (
  <>{limit !== null || interval === null ? "–" : interval}</>
);

/** A number and its interval. */
export function Estimate({ of, unit }: EstimateProps) {
  const range = of.limit === null && of.value !== null ? rangeText(of.interval) : "";
  return (
    <span class="with-range">
      <EstimateValue of={of} {...(unit === undefined ? {} : { unit })} />
      {range && <span class="soft range"> {range}</span>}
    </span>
  );
}
