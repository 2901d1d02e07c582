/** The tables of a job, and its evidence in lines, as the service writes them for the terminal and for reports. */
import { api } from "../api/client";
import type { Collection } from "../api/events";
import { sentence } from "../lib/said";
import { STIFFNESS_UNITS } from "../lib/units";
import { useCached } from "../state/load";
import { useSettings } from "../state/settings";
import { Prose, Show } from "./basics";
import { TableCard } from "./table";

function useTables(collection: Collection, id: string) {
  const unit = STIFFNESS_UNITS[useSettings().unit].name;
  const ask = () => api.tables(id, { unit, details: String(collection !== "comparisons") });
  return useCached(`tables/${id}/${unit}`, ask, Number.POSITIVE_INFINITY);
}

export function JobTables({
  collection,
  id,
  from = 0,
  to,
}: {
  collection: Collection;
  id: string;
  /** The first one shown, and the first one not shown. */
  from?: number;
  to?: number | undefined;
}) {
  return (
    <Show of={useTables(collection, id)}>
      {({ tables }) =>
        tables
          .slice(from, to)
          .map(({ title, caption, head, rows, texts }) => (
            <TableCard title={title || (head[1] ?? "")} note={caption} table={{ columns: head, rows, texts }} />
          ))
      }
    </Show>
  );
}

/** What the service says of a job in lines: of its result, or of the evidence for it. */
export const JobLines = ({
  collection,
  id,
  of = "lines",
}: {
  collection: Collection;
  id: string;
  of?: "lines" | "evidence";
}) => (
  <Show of={useTables(collection, id)}>
    {(said) => (
      <ul class="lines">
        {said[of].map((line) => (
          <li>
            <Prose text={sentence(line)} />
          </li>
        ))}
      </ul>
    )}
  </Show>
);
