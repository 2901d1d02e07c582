/** The head of a column: what it was taken for, to be changed, its unit, and what is wrong with it. */
import type { ImportOptions } from "../api/types";
import { Faults } from "../components/fields";
import {
  type ColumnMeaning,
  dimensionOf,
  type ImportFault,
  type MeaningGroup,
  said,
  UNITS,
  UNKNOWN,
  writtenHeader,
} from "../lib/columns";
import { text } from "../i18n";

const words = text.imports;

export function ColumnHead({
  column,
  faults,
  groups,
  options,
  mean,
  change,
}: {
  column: ColumnMeaning;
  faults: ImportFault[];
  groups: MeaningGroup[];
  options: ImportOptions;
  mean: (meaning: string) => void;
  change: (options: ImportOptions) => void;
}) {
  const header = writtenHeader(options, column) || words.columnNumber(column.column);
  const unknown = column.meaning === UNKNOWN;
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
          <option value={UNKNOWN} selected>
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
      <Faults faults={plain === null ? faults.map(said) : [plain]} />
    </th>
  );
}

/** What to do where the remedy is a choice that stands above it; null for the service's own words. */
function plainly(faults: ImportFault[], unknown: boolean): string | null {
  if (unknown && faults.every(({ option }) => option === "columns")) return words.chooseMeaning;
  const units = faults.length > 0 && faults.every(({ option }) => option?.startsWith("units."));
  return units ? words.chooseUnit : null;
}

/** The unit that the file says, or one to choose, which holds for all columns of its dimension. */
function Unit({
  column,
  header,
  options,
  change,
}: {
  column: ColumnMeaning;
  header: string;
  options: ImportOptions;
  change: (options: ImportOptions) => void;
}) {
  const dimension = dimensionOf(column.meaning);
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
      {UNITS[dimension].map((unit) => (
        <option value={unit} selected={unit === stated}>
          {unit}
        </option>
      ))}
    </select>
  );
}
