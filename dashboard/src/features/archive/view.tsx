/** All records in one file, and records of such a file added: what a restore would do is shown before it is done. */
import { useState } from "preact/hooks";
import { api } from "../../api/calls";
import { queries } from "../../api/queries";
import type { RestoreReport, TableReport } from "../../api/types";
import {
  ActionButton,
  Busy,
  Download,
  Name,
  ProblemNote,
  ProgressBar,
  Prose,
  Show,
  Title,
} from "../../components/basics";
import { DropZone } from "../../components/schema_form";
import { DataTable } from "../../components/table";
import { text } from "../../words";
import { fixed } from "../../lib/format";
import { useAction } from "../../state/action";
import { useQuery } from "../../state/query";
import { mayArchive } from "../../state/session";
import { archiveWords } from "./words";

const words = archiveWords;

export function ArchiveView() {
  const session = useQuery(queries.session);
  return (
    <>
      <Title plain={text.app.archive}>{text.app.archive}</Title>
      <Show of={session}>
        {(who) =>
          mayArchive(who) ? (
            <>
              <Save />
              <Restore />
            </>
          ) : (
            <p class="note">
              <Prose text={words.forbidden} />
            </p>
          )
        }
      </Show>
    </>
  );
}

const Save = () => (
  <section class="card form" aria-labelledby="save">
    <h2 id="save">{words.save}</h2>
    <p>{words.saveHint}</p>
    <div class="row">
      <Download look="primary" href={api.archives.address}>
        {words.download}
      </Download>
    </div>
  </section>
);

function Restore() {
  const [file, setFile] = useState<File | null>(null);
  const [report, setReport] = useState<RestoreReport | null>(null);
  const [isRestored, setRestored] = useState(false);
  const check = useAction(async (chosen: File) => {
    setFile(chosen);
    setReport(null);
    setRestored(false);
    await api.archives.restore(chosen, true, setReport);
  });
  const restore = useAction(async () => {
    if (!file) return;
    await api.archives.restore(file, false, setReport);
    setRestored(true);
  });
  const isBusy = check.busy || restore.busy;
  const isPlan = !restore.busy && !isRestored && restore.problem === null;
  const count = report ? sumOf(report, ({ added }) => added) : 0;
  return (
    <section class="card form" aria-labelledby="restore">
      <h2 id="restore">{words.restore}</h2>
      <p>{words.restoreHint}</p>
      {!isBusy && (
        <DropZone
          compact
          title={words.restore}
          hint={words.restoreHint}
          button={file ? words.choosing : words.choose}
          accept=".zip,application/zip"
          take={check.run}
        />
      )}
      {file && (
        <p>
          <Name>{report?.layout ? words.ofArchive(file.name, report.layout.split("_")[0] ?? "") : file.name}</Name>
        </p>
      )}
      {check.problem && <ProblemNote problem={check.problem} />}
      {isBusy && !report && <Busy label={words.reading} />}
      {isBusy && report && <Going report={report} label={check.busy ? words.reading : words.restoring} />}
      {report && !check.problem && (
        <>
          <Counted report={report} added={isPlan ? words.toAdd : words.added} />
          <Skipped report={report} />
          {isRestored && <p class="note good">{words.finished(count)}</p>}
          {restore.problem && <p class="note warn">{words.again}</p>}
          {!isRestored && !check.busy && count === 0 && !restore.busy && <p class="soft">{words.nothing}</p>}
          {!isRestored && !check.busy && (count > 0 || restore.busy) && (
            <ActionButton look="primary big" action={restore} going={words.restoring}>
              {words.begin(count)}
            </ActionButton>
          )}
        </>
      )}
    </section>
  );
}

const sumOf = ({ tables }: RestoreReport, of: (table: TableReport) => number): number =>
  Object.values(tables).reduce((sum, table) => sum + of(table), 0);

const readOf = ({ added, present, refused, omitted }: TableReport): number => added + present + refused + omitted;

/** How far the lines of the archive are read. */
const Going = ({ report, label }: { report: RestoreReport; label: string }) => (
  <ProgressBar
    done={sumOf(report, readOf)}
    total={Math.max(
      1,
      sumOf(report, ({ lines }) => lines),
    )}
  >
    {label}
  </ProgressBar>
);

/** Numbers of records by kind, and what comes of them. */
function Counted({ report, added }: { report: RestoreReport; added: string }) {
  const whole = (title: string) => ({ title, show: (value: number) => fixed(value, 0) });
  const rows = Object.entries(report.tables).map(([name, table]) => [
    words.tables[name] ?? name,
    table.added,
    table.present,
    table.refused,
    table.lines,
  ]);
  const columns = [words.records, ...[added, words.present, words.refused, words.inArchive].map(whole)];
  return <DataTable caption={words.records} table={{ columns, rows }} />;
}

/** What is not restored, and why. */
function Skipped({ report }: { report: RestoreReport }) {
  const { tables, dropped, left_out: left } = report;
  const reasons = Object.values(tables).flatMap((table) => table.reasons);
  const isSome = ([, count]: [string, number]) => count > 0;
  const lines = [
    ...Object.entries(left)
      .filter(isSome)
      .map(([name, count]) => words.leftOut(words.tables[name] ?? name, count)),
    ...Object.entries(dropped).map(([name, count]) => words.dropped(name, count)),
  ];
  return (
    <>
      {reasons.length > 0 && (
        <div class="note warn">
          <p>{words.refused}:</p>
          <ul>
            {reasons.map((reason) => (
              <li>
                <bdi>{reason}</bdi>
              </li>
            ))}
          </ul>
        </div>
      )}
      {lines.map((line) => (
        <p class="soft">
          <Prose text={line} />
        </p>
      ))}
    </>
  );
}
