/** The first rows of a file, a meaning and a unit over each column, and faults in their cells. */
import { useId } from "preact/hooks";
import type { ImportOptions } from "../api/types";
import { Button, Prose } from "../components/basics";
import { Faults } from "../components/fields";
import { Scroll } from "../components/table";
import {
  cellOf,
  type FilePreview,
  HEADER,
  type ImportFault,
  type MeaningGroup,
  said,
  UNKNOWN,
  withMeaning,
  withoutColumns,
  writtenHeader,
} from "../lib/columns";
import { useLines } from "../state/lines";
import { text } from "../i18n";
import { ColumnHead } from "./import_column";

const words = text.imports;

interface Props {
  preview: FilePreview;
  /** As it was dropped, to show rows that the preview leaves out. */
  file: File | undefined;
  faults: ImportFault[];
  options: ImportOptions;
  change: (options: ImportOptions) => void;
  groups: MeaningGroup[];
}

export function ImportTable({ preview, file, faults, options, change, groups }: Props) {
  const id = useId();
  const further = useLines(file, preview, faults);
  const rows = [
    ...preview.first_rows.map((cells, i) => ({ line: preview.first_lines[i] ?? i + 1, cells })),
    ...further,
  ];
  const shown = rows.map(({ line }) => line);
  const places = faults.map((fault) => cellOf(preview, fault, shown));
  const at = (line: number, column: number) => faults.filter((_, i) => places[i] === `${line}:${column}`);
  return (
    <section class="import-file" aria-labelledby={`${id}-name`}>
      <h3 id={`${id}-name`} class="file">
        <bdi>{preview.file}</bdi>
      </h3>
      <p class="soft">{words.fileFacts(preview)}</p>
      <ToLookAt preview={preview} options={options} change={change} places={places} table={id} />
      <Scroll label={words.firstRows(preview.file)}>
        <table class="readings" id={id}>
          <thead>
            <tr>
              <th scope="col">
                <span class="hidden">{words.line}</span>
              </th>
              {preview.columns.map((column, i) => (
                <ColumnHead
                  column={column}
                  faults={at(HEADER, i + 1)}
                  groups={groups}
                  options={options}
                  mean={(meaning) => change(withMeaning(options, preview, i, meaning))}
                  change={change}
                />
              ))}
            </tr>
          </thead>
          <tbody>
            {rows.map(({ line, cells }, r) => (
              <tr class={r >= preview.first_rows.length ? "further" : undefined}>
                <th scope="row">{line}</th>
                {cells.map((cell, i) => {
                  const here = at(line, i + 1);
                  return (
                    <td class={here.length > 0 ? "faulty" : undefined}>
                      <bdi>{cell}</bdi>
                      <Faults faults={here.map(said)} />
                    </td>
                  );
                })}
              </tr>
            ))}
          </tbody>
        </table>
      </Scroll>
      <FaultList faults={faults.filter((_, i) => places[i] === null)} />
      {preview.assumptions.length > 0 && (
        <ul class="assumptions">
          {preview.assumptions.map((assumption) => (
            <li>{assumption}</li>
          ))}
        </ul>
      )}
    </section>
  );
}

/** As many columns are named. */
const IN_VIEW = 8;

/** Columns that want a look, far to the right as they may be: a tap brings each into view. */
function ToLookAt({
  preview,
  options,
  change,
  places,
  table,
}: {
  preview: FilePreview;
  options: ImportOptions;
  change: (options: ImportOptions) => void;
  places: (string | null)[];
  table: string;
}) {
  const faulty = new Set(places.flatMap((place) => (place === null ? [] : [Number(place.split(":")[1])])));
  const columns = preview.columns.filter(
    ({ column, guessed, meaning }) => faulty.has(column) || guessed || meaning === UNKNOWN,
  );
  if (columns.length === 0) return null;
  const unknown = columns.filter(({ meaning }) => meaning === UNKNOWN);
  const show = (column: number) => {
    const head = document.getElementById(table)?.querySelectorAll("thead th")[column];
    head?.scrollIntoView({ block: "nearest", inline: "center" });
    head?.querySelector("select")?.focus({ preventScroll: true });
  };
  return (
    <div class="to-look-at">
      <span>{words.toLookAt}</span>
      {columns.slice(0, IN_VIEW).map((column) => (
        <button
          type="button"
          class={faulty.has(column.column) || column.meaning === UNKNOWN ? "button bad" : "button"}
          onClick={() => show(column.column)}
        >
          <bdi>{writtenHeader(options, column) || words.columnNumber(column.column)}</bdi>
        </button>
      ))}
      {columns.length > IN_VIEW && <span class="soft">{words.andMore(columns.length - IN_VIEW)}</span>}
      {unknown.length > 1 && (
        <Button onClick={() => change(withoutColumns(options, preview, unknown))}>
          {words.leaveUnknown(unknown.length)}
        </Button>
      )}
    </div>
  );
}

/** Faults that stand in no cell that is shown, by their place. */
export function FaultList({ faults }: { faults: ImportFault[] }) {
  if (faults.length === 0) return null;
  return (
    <ul class="warnings" role="alert">
      {faults.map((fault) => (
        <li class="note bad">
          <p>
            {fault.file !== null && <b>{words.place(fault)}: </b>}
            <Prose text={fault.reason} />
          </p>
          <p>
            <b>{text.errors.remedy}:</b> <Prose text={fault.remedy} />
          </p>
        </li>
      ))}
    </ul>
  );
}
