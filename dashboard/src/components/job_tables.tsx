/** The tables of a job as the service writes them for the terminal and for reports. */
import { api } from "../api/client";
import type { Collection } from "../api/events";
import { STIFFNESS_UNITS } from "../lib/units";
import { useCached } from "../state/cache";
import { useSettings } from "../state/settings";
import { Show } from "./basics";
import { TableCard } from "./table";

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
  const unit = STIFFNESS_UNITS[useSettings().unit].name;
  const tables = useCached(
    `tables/${id}/${unit}`,
    () => api.tables(id, { unit, details: String(collection !== "comparisons") }),
    Number.POSITIVE_INFINITY,
  );
  return (
    <Show of={tables}>
      {(all) =>
        all
          .slice(from, to)
          .map(({ title, caption, head, rows, texts }) => (
            <TableCard title={title || (head[1] ?? "")} note={caption} table={{ columns: head, rows, texts }} />
          ))
      }
    </Show>
  );
}
