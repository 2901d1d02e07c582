/** The first rows of a file, a meaning and a unit over each column, and faults in their cells. */
import { useId } from "preact/hooks";
import * as imports from "./imports";
import type { ImportOptions } from "../../api/types";
import { Faults } from "../../components/fields";
import { text } from "../../words";
import { Button, Prose } from "../../components/basics";
import { Scroll } from "../../components/table";
import { importWords } from "./words";

const words = importWords;

interface Told {
  options: ImportOptions;
  change: (options: ImportOptions) => void;
}

interface Props extends Told {
  preview: imports.FilePreview;
  faults: imports.ImportFault[];
  groups: imports.MeaningGroup[];
  /** Id of the chosen robot; empty while none is chosen. */
  robot: string;
}

export function ImportTable({ preview, faults, options, change, groups, robot }: Props) {
  const id = useId();
  const lines = [...preview.first_lines, ...preview.fault_lines];
  const rows = [...preview.first_rows, ...preview.fault_rows].map((cells, i) => ({ line: lines[i] ?? i + 1, cells }));
  const shown = rows.map(({ line }) => line);
  const places = faults.map((fault) => imports.cellOf(preview, fault, shown));
  const at = (line: number, column: number) => faults.filter((_, i) => places[i] === `${line}:${column}`);
  return (
    <section class="import-file" aria-labelledby={`${id}-name`}>
      <h3 id={`${id}-name`} class="file">
        <bdi>{preview.file}</bdi>
      </h3>
      <p class="soft">{words.fileFacts(preview)}</p>
      <ToLookAt {...{ preview, options, change, places, robot }} table={id} />
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
                  faults={at(imports.HEADER, i + 1)}
                  groups={groups}
                  options={options}
                  mean={(meaning) => change(imports.withMeaning(options, preview, i, meaning))}
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
                      <Faults role="alert" faults={here.map(imports.said)} />
                    </td>
                  );
                })}
              </tr>
            ))}
          </tbody>
        </table>
      </Scroll>
      <FaultList faults={faults.filter((_, i) => places[i] === null)} />
      <Assumptions of={preview.assumptions} />
    </section>
  );
}

/** What was assumed of a file, to be checked. */
export const Assumptions = ({ of }: { of: string[] }) =>
  of.length === 0 ? null : (
    <ul class="assumptions">
      {of.map((assumption) => (
        <li>{assumption}</li>
      ))}
    </ul>
  );

/** As many columns are named. */
const IN_VIEW = 8;

/** Columns that want a look, far to the right as they may be: a tap brings each into view. */
interface LookProps extends Told {
  preview: imports.FilePreview;
  places: (string | null)[];
  table: string;
  robot: string;
}

function ToLookAt({ preview, options, change, places, table, robot }: LookProps) {
  const faulty = new Set(places.flatMap((place) => (place === null ? [] : [Number(place.split(":")[1])])));
  const columns = preview.columns.filter(
    ({ column, guessed, meaning }) => faulty.has(column) || guessed || meaning === imports.UNKNOWN,
  );
  if (columns.length === 0) return null;
  // A robot's own names of its joints are known when the robot is chosen.
  const joints = robot === "" ? imports.maybeJoints(preview) : [];
  const unknown = columns.filter((column) => column.meaning === imports.UNKNOWN && !joints.includes(column));
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
          class={faulty.has(column.column) || column.meaning === imports.UNKNOWN ? "button bad" : "button"}
          onClick={() => show(column.column)}
        >
          <bdi>{imports.writtenHeader(options, column) || words.columnNumber(column.column)}</bdi>
        </button>
      ))}
      {columns.length > IN_VIEW && <span class="soft">{text.more(columns.length - IN_VIEW)}</span>}
      {unknown.length > 1 && (
        <Button onClick={() => change(imports.withoutColumns(options, preview, unknown))}>
          {words.leaveUnknown(unknown.length)}
        </Button>
      )}
      {joints.length > 0 && <span>{words.robotFirst}</span>}
    </div>
  );
}

/** Faults that stand in no cell that is shown, by their place. */
export function FaultList({ faults }: { faults: imports.ImportFault[] }) {
  if (faults.length === 0) return null;
  return (
    <div role="alert">
      <ul class="warnings">
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
    </div>
  );
}

/** The head of a column: what it was taken for, to be changed, its unit, and what is wrong with it. */
interface HeadProps extends Told {
  column: imports.ColumnMeaning;
  faults: imports.ImportFault[];
  groups: imports.MeaningGroup[];
  mean: (meaning: string) => void;
}

function ColumnHead({ column, faults, groups, options, mean, change }: HeadProps) {
  const header = imports.writtenHeader(options, column) || words.columnNumber(column.column);
  const unknown = column.meaning === imports.UNKNOWN;
  const listed = unknown || groups.some(({ meanings }) => meanings.includes(column.meaning));
  const plain = plainly(faults, unknown);
  const kind = faults.length > 0 || unknown ? "faulty" : column.guessed ? "guessed" : undefined;
  return (
    <th scope="col" class={kind}>
      <bdi class="as-written">{header}</bdi>
      <select
        aria-label={words.meaningOf(header)}
        aria-invalid={kind === "faulty"}
        value={column.meaning}
        onChange={(event) => mean(event.currentTarget.value)}
      >
        {unknown && (
          <option value={imports.UNKNOWN} selected>
            {words.unknown}
          </option>
        )}
        {!listed && (
          <option value={column.meaning} selected>
            {column.meaning}
          </option>
        )}
        {groups.map((group) => (
          <optgroup label={group.name || words.groups[group.group]}>
            {group.meanings.map((meaning) => (
              <option value={meaning} selected={meaning === column.meaning}>
                {words.meanings[meaning] ?? meaning}
              </option>
            ))}
          </optgroup>
        ))}
      </select>
      <Unit column={column} header={header} options={options} change={change} />
      {column.guessed && <small class="guess">{words.guessed}</small>}
      <Faults role="alert" faults={plain === null ? faults.map(imports.said) : [plain]} />
    </th>
  );
}

/** What to do where the remedy is a choice that stands above it; null for the service's own words. */
function plainly(faults: imports.ImportFault[], unknown: boolean): string | null {
  if (unknown && faults.every(({ option }) => option === "columns")) return words.chooseMeaning;
  const units = faults.length > 0 && faults.every(({ option }) => option?.startsWith("units."));
  return units ? words.chooseUnit : null;
}

/** The unit that the file says, or one to choose, which holds for all columns of its dimension. */
function Unit({ column, header, options, change }: Told & { column: imports.ColumnMeaning; header: string }) {
  const dimension = imports.dimensionOf(column.meaning);
  if (dimension === null) return <span class="unit">{column.unit ?? ""}</span>;
  const stated = options.units?.[dimension] ?? null;
  if (column.unit !== null && stated === null) return <span class="unit">{column.unit}</span>;
  return (
    <select
      aria-label={words.unitOf(header)}
      aria-invalid={stated === null}
      value={stated ?? ""}
      onChange={(event) =>
        change({ ...options, units: { ...options.units, [dimension]: event.currentTarget.value || null } })
      }
    >
      <option value="">{words.pickUnit}</option>
      {imports.UNITS[dimension].map((unit) => (
        <option value={unit} selected={unit === stated}>
          {unit}
        </option>
      ))}
    </select>
  );
}
