/** Tables of the service: their numbers by the component of estimates, their words as they are. */
import type { NumberParts, ShownTable } from "../api/types";
import type { ShownEstimate } from "../lib/estimate";
import { Estimate, EstimateInterval } from "./estimate";
import type { Cell, Table } from "./table";

/** A number as the component shows it; what it has not is null. */
const estimateOf = ({ value, interval, limit, relative }: NumberParts, unusable: boolean): ShownEstimate => ({
  value: value || null,
  interval: interval || null,
  limit: limit || null,
  relative,
  unusable,
});

function NumberCell({ parts, unusable }: { parts: NumberParts; unusable: boolean }) {
  const of = estimateOf(parts, unusable);
  const isIntervalAlone = of.value === null && of.limit === null;
  return isIntervalAlone ? <EstimateInterval of={of} /> : <Estimate of={of} unit={parts.unit} />;
}

/** The table as the page draws it. */
export function tableOf({ head, rows, texts, dim, numbers }: ShownTable): Table {
  const isDim = (y: number, x: number) => dim.some(([row, column]) => row === y && column === x);
  const cells: Cell[][] = rows.map((row) => [...row]);
  for (const [y, x, all] of numbers) {
    const shown = all.map((parts, i) => (
      <>
        {i > 0 && ", "}
        <NumberCell parts={parts} unusable={isDim(y, x)} />
      </>
    ));
    (cells[y] ?? [])[x] = <>{shown}</>;
  }
  return { columns: head, rows: cells, texts, dim };
}
