/** The colours of a quantity from its least to its greatest value. */
import { fixed } from "../lib/format";

interface RampLegendProps {
  scale: readonly [number, number];
  unit: string;
  label: string;
}

/** The colours with their ends in numbers. */
export function RampLegend({ scale: [low, high], unit, label }: RampLegendProps) {
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
