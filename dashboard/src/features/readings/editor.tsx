/** The first rows of a table with a role above each column, and the dialog that changes a role. */
import { useEffect, useId, useRef, useState } from "preact/hooks";
import type { Mapping, Role } from "../../api/types";
import { Button, Choice, usePhone } from "../../components/basics";
import { Select, TextField } from "../../components/fields";
import { Scroll } from "../../components/table";
import * as roles from "./mapping";
import { importWords } from "./words";

const words = importWords;

interface EditorProps {
  table: roles.Table;
  mapping: Mapping;
  change: (mapping: Mapping) => void;
  /** Number of joints of the robot. */
  joints: number;
  /** What the check says of the mapping as it is. */
  check: string;
}

/** A table with the role of each column; on a phone its groups of columns, one below the other. */
export function TableEditor({ table, mapping, change, joints, check }: EditorProps) {
  const isPhone = usePhone();
  const id = useId();
  /** Id of the column that was tapped. */
  const [tapped, setTapped] = useState<string | null>(null);
  const groups = roles.groupsOf(mapping, table);
  const edited = groups.find(({ columns }) => columns.some((column) => column.id === tapped));
  const targets = roles.targetsOf(mapping);
  const heads = groups.map((group) => ({
    group,
    look: lookOf(group.role, targets),
    title: titleOf(group.role),
    range: rangeOf(group),
    open: () => setTapped(group.columns[0]?.id ?? null),
  }));
  return (
    <section class="card import-table" aria-labelledby={id}>
      <h2 id={id} class="file">
        <bdi>{table.name}</bdi> <small class="soft">{words.size(table.row_count, table.columns.length)}</small>
      </h2>
      {isPhone ? (
        <ul class="groups">
          {heads.map(({ group, look, title, range, open }) => (
            <li>
              <button type="button" class={look} onClick={open} aria-haspopup="dialog">
                <small>{range}</small>
                <b>{title}</b>
                <span class="raw">
                  <bdi>{shownOf(group)}</bdi>
                </span>
              </button>
            </li>
          ))}
        </ul>
      ) : (
        <Scroll label={words.firstRows(table.name)}>
          <table class="readings">
            <thead>
              <tr>
                {heads.map(({ group, look, title, range, open }) => (
                  <th scope="colgroup" colSpan={group.columns.length} class={look}>
                    <button type="button" onClick={open} aria-haspopup="dialog">
                      {title} <small>{range}</small>
                    </button>
                  </th>
                ))}
              </tr>
              {table.columns.some(({ header }) => header !== "") && (
                <tr>
                  {table.columns.map(({ header }) => (
                    <th scope="col">
                      <bdi>{header}</bdi>
                    </th>
                  ))}
                </tr>
              )}
            </thead>
            <tbody>
              {(table.columns[0]?.cells ?? []).map((_, row) => (
                <tr>
                  {heads.map(({ group, look }) =>
                    group.columns.map(({ cells }) => (
                      <td class={look}>
                        <bdi>{shownCell(cells[row])}</bdi>
                      </td>
                    )),
                  )}
                </tr>
              ))}
            </tbody>
          </table>
        </Scroll>
      )}
      {edited && (
        <RoleDialog {...{ table, mapping, change, joints, check }} group={edited} close={() => setTapped(null)} />
      )}
    </section>
  );
}

/** The class of a group's colour: one for joints, one for loads, one for each target, deeper under load. */
function lookOf(role: Role | null, targets: string[]): string {
  if (role === null) return "k-unread";
  if (role.role === "joints") return "k-joints";
  if (["force", "moment", "load", "mass"].includes(role.role)) return "k-load";
  const place = Math.max(0, targets.indexOf(role.target ?? ""));
  const isPlace = ["position", "displacement", "value", "uncertainty"].includes(role.role);
  const depth = role.state === "loaded" || role.role === "displacement" ? " deep" : "";
  return isPlace ? `k-target-${place % COLOURS}${depth}` : "k-named";
}

const COLOURS = 3;

function titleOf(role: Role | null): string {
  if (role === null) return words.unused;
  const state = role.state ? words.states[role.state] : "";
  const what = role.role === "position" && role.target ? "" : words.roles[role.role];
  const unit = role.unit ? `[${words.units[role.unit] ?? role.unit}]` : "";
  return [role.target, state, what, role.axis, unit].filter(Boolean).join(" ");
}

function rangeOf({ columns }: roles.Group): string {
  const [first, last] = [columns[0]?.id ?? "", columns.at(-1)?.id ?? ""];
  return first === last ? first : `${first} – ${last}`;
}

/** The headers of a group and its first cells, as far as a line has room. */
function shownOf({ columns }: roles.Group): string {
  const headers = columns.map(({ header }) => header).filter(Boolean);
  const cells = columns.map(({ cells }) => shownCell(cells[0]));
  return [headers.length > 1 ? `${headers[0]} …` : headers[0], cells.join(" ")].filter(Boolean).join(" = ");
}

const shownCell = (cell: string | number | null | undefined): string =>
  typeof cell === "number" ? String(Number(cell.toPrecision(DIGITS))).replace("-", "\u2212") : (cell ?? "");

const DIGITS = 7; // 0.1 µm of a metre

interface DialogProps extends EditorProps {
  group: roles.Group;
  close: () => void;
}

/** The role of a group of columns. Each choice applies at once, and the check answers below. */
function RoleDialog({ table, mapping, change, joints, check, group, close }: DialogProps) {
  const dialog = useRef<HTMLDialogElement>(null);
  const id = useId();
  useEffect(() => {
    const before = document.activeElement;
    dialog.current?.showModal();
    return () => before instanceof HTMLElement && before.focus();
  }, []);
  const { role } = group;
  const columns = role === null ? group.columns.map((column) => column.id) : roles.columnsOf(role, table);
  const choose = (name: roles.RoleName | null) => {
    if (name === null) return change(roles.withRole(mapping, table, columns, null));
    const wanted = roles.columnsFor(name, group, mapping, table, joints);
    change(roles.withRole(mapping, table, wanted, roles.usualMeaning(name, mapping, table)));
  };
  const headers = group.columns.map(({ header }) => header).filter(Boolean);
  return (
    <dialog
      class="card roles"
      ref={dialog}
      aria-labelledby={id}
      onCancel={(event) => {
        event.preventDefault(); // the view closes it
        close();
      }}
    >
      <div>
        <h2 id={id}>
          {words.columns(rangeOf(group))} <small class="soft">{headers.join(", ")}</small>
        </h2>
        <div class="names">
          {([...words.offered, null] as const).map((name) => (
            <Button aria-pressed={name === (role?.role ?? null)} onClick={() => choose(name)}>
              {name === null ? words.unused : words.roles[name]}
            </Button>
          ))}
        </div>
        {role && <RoleDetails {...{ table, mapping, group, role }} change={change} />}
        <p class="check" role="status">
          {check}
        </p>
        <Button look="primary" onClick={close}>
          {words.done}
        </Button>
      </div>
    </dialog>
  );
}

interface DetailsProps extends Pick<EditorProps, "table" | "mapping" | "change"> {
  group: roles.Group;
  role: Role;
}

/** What a role says apart from its name: target, state, unit, axis, columns, and the meaning of words. */
function RoleDetails({ table, mapping, change, group, role }: DetailsProps) {
  const columns = roles.columnsOf(role, table);
  const put = (part: Partial<Role>, to = columns) => change(roles.withRole(mapping, table, to, { ...role, ...part }));
  const isPlace = ["position", "displacement", "uncertainty"].includes(role.role);
  const known = roles.targetsOf(mapping);
  const next = `T${known.length + 1}`;
  const targets = [...known, ...(known.includes(next) ? [] : [next])];
  const units = roles.UNITS[role.role] ?? [];
  const hasAxis = columns.length === 1 && ["force", "displacement"].includes(role.role);
  return (
    <>
      {isPlace && (
        <Choice
          label={words.target}
          value={role.target ?? ""}
          change={(target) => put({ target: target || null })}
          options={[
            { value: "", label: words.byRow },
            ...targets.map((name) => ({ value: name, label: known.includes(name) ? name : words.another(name) })),
          ]}
        />
      )}
      {role.role === "position" && (
        <Choice
          label={words.state}
          value={role.state ?? ""}
          change={(state) => put({ state: (state || null) as NonNullable<Role["state"]> | null })}
          options={{ "": words.byRow, ...words.states }}
        />
      )}
      {units.length > 0 && (
        <Choice
          label={words.unit}
          value={role.unit ?? ""}
          change={(unit) => put({ unit: unit as NonNullable<Role["unit"]> })}
          options={units.map((unit) => ({ value: unit, label: words.units[unit] ?? unit }))}
        />
      )}
      {hasAxis && (
        <Choice
          label={words.axis}
          value={role.axis ?? ""}
          change={(axis) => put({ axis: axis as NonNullable<Role["axis"]> })}
          options={["x", "y", "z"].map((axis) => ({ value: axis, label: axis }))}
        />
      )}
      {role.role === "state" &&
        roles
          .wordsOf(group)
          .map((word) => (
            <Select
              label={words.meaningOf(word)}
              value={role.words?.[word] ?? ""}
              change={(meaning) => put({ words: { ...role.words, [word]: meaning } })}
              options={{ "": words.asWritten, ...words.states, ignore: words.leaveOut }}
            />
          ))}
      <ColumnsField value={role.columns} table={table} change={(to) => put({}, to)} />
    </>
  );
}

interface ColumnsProps {
  value: string;
  table: roles.Table;
  change: (columns: string[]) => void;
}

/** The columns of a role, as in a spreadsheet; they apply once the table has all of them. */
function ColumnsField({ value, table, change }: ColumnsProps) {
  const [typed, setTyped] = useState(value);
  useEffect(() => setTyped(value), [value]);
  const ids = table.columns.map(({ id }) => id);
  const type = (text: string) => {
    setTyped(text);
    const columns = roles.columnsOf({ columns: text, role: "ignore" }, table);
    if (columns.every((id) => ids.includes(id))) change(columns);
  };
  return <TextField label={words.columnsField} help={words.columnsHelp} value={typed} change={type} />;
}
