/** The rehearsal of a run or a plan: its readings simulated with known stiffnesses, and identified. */
import { useEffect, useState } from "preact/hooks";
import { queries } from "../../api/queries";
import { ActionButton, Prose } from "../../components/basics";
import { tableOf } from "../../components/shown_table";
import { DataTable, type Table } from "../../components/table";
import { sentence } from "../../lib/said";
import { STIFFNESS_UNITS } from "../../lib/stiffness";
import { useAction } from "../../state/action";
import { ask, useQuery } from "../../state/query";
import { useSettings } from "../../state/session";
import { rehearsalWords } from "./words";

const words = rehearsalWords;

/** What was planted stands last: a phone shows at first what was found, and its interval. */
const plantedLast = <T,>([joint, planted, ...found]: T[]): T[] => [joint, ...found, planted] as T[];

const plantedAtEnd = ({ columns, rows, texts }: Table): Table => ({
  columns: plantedLast(columns),
  rows: rows.map(plantedLast),
  ...(texts ? { texts } : {}),
});

export function Rehearsal({ job, atOnce = false }: { job: string; atOnce?: boolean }) {
  const [seed, setSeed] = useState(0); // 0: not rehearsed yet
  const unit = STIFFNESS_UNITS[useSettings().unit].name;
  const rehearsed = (of: number) => queries.rehearsal(job, { unit, seed: String(of) });
  const rehearse = useAction(async () => {
    await ask(rehearsed(seed + 1));
    setSeed(seed + 1);
  }, "rehearsal");
  useEffect(() => {
    if (atOnce) rehearse.run();
  }, []);
  const { data } = useQuery({ ...rehearsed(seed), enabled: seed > 0 });
  const [verdict, ...lines] = data?.lines ?? [];
  return (
    <section class="card wraps" aria-labelledby="rehearsal">
      <h2 id="rehearsal">{words.title}</h2>
      <p class="soft">{words.intro}</p>
      <ActionButton action={rehearse} going={words.going}>
        {seed > 0 ? words.again : words.go}
      </ActionButton>
      {verdict && (
        <div role="status">
          <h3>{sentence(verdict)}</h3>
          <ul class="lines">
            {lines.map((line) => (
              <li>
                <Prose text={sentence(line)} />
              </li>
            ))}
          </ul>
        </div>
      )}
      {data?.tables.map((table) => (
        <>
          <p class="soft">{sentence(table.caption)}</p>
          <DataTable caption={words.title} table={plantedAtEnd(tableOf(table))} />
        </>
      ))}
    </section>
  );
}
