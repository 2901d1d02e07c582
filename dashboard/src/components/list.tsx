/** Lists of whatever is stored: filtered by words, robot and verdict, sorted; and what can be done with a row. */
import type { Usability } from "../api/types";
import { readdress, useAction, useDeletion } from "../state/action";
import { useKeptOnEntry } from "../state/entry";
import { askFor, sure } from "../state/question";
import { text } from "../words";
import { Name, Button, Icon, ProblemNote, Folded, When } from "./basics";
import { RobotSelect, useTyped } from "./choosers";
import type { ComponentChildren } from "preact";
import { Select, TextField } from "./fields";

/** Deletes a row at once; its toast offers to undo that. */
export const DeleteButton = ({ name, remove }: { name: string; remove: () => void }) => (
  <Button acts look="quiet icon" aria-label={words.delete(name)} title={text.run.delete} onClick={remove}>
    <Icon d="M5 7h14M10 7V5h4v2M7 7l1 12h8l1-12M10.5 11v5M13.5 11v5" />
  </Button>
);

interface Change {
  name: string;
}

interface Stored {
  change: (id: string, change: Change) => Promise<unknown>;
  delete: (id: string) => Promise<unknown>;
  restore: (id: string) => Promise<unknown>;
}

interface StoredProps {
  of: { id: string; name: string };
  api: Stored;
  /** Address of the list that it stands in. */
  list: string;
}

/** What can be done with any robot and any set. Deletion is asked first; while others refer to it the service refuses. */
export function StoredActions({ of: { id, name }, api, list }: StoredProps) {
  const words = text.changes;
  const action = useAction((asked: Change) => api.change(id, asked).then(() => undefined));
  const deletion = useDeletion({
    remove: () => api.delete(id),
    restore: () => api.restore(id),
    list,
    deleted: text.deletion.done(name),
  });
  const rename = async () => {
    const typed = (await askFor(words.newName, name))?.trim();
    if (typed && typed !== name) action.run({ name: typed });
  };
  const remove = async () => {
    if (await sure(text.deletion.sure(name))) deletion.run();
  };
  const problem = action.problem ?? deletion.problem;
  return (
    <>
      <Button acts look="quiet" disabled={action.busy} onClick={() => void rename()}>
        {words.rename}
      </Button>
      <Button acts look="quiet" disabled={deletion.busy} onClick={() => void remove()}>
        {text.run.delete}
      </Button>
      {problem && <ProblemNote problem={problem} />}
    </>
  );
}

const words = text.list;

/** A row: its name, how, when, and how it stands. */
export interface Row {
  id: string;
  /** Address that the row leads to, if any. */
  href?: string | undefined;
  /** Beneath its name. */
  note?: ComponentChildren;
  how?: ComponentChildren;
  figures?: ComponentChildren;
  /** When it was measured or made; null for never. */
  at?: string | null;
  standing?: ComponentChildren;
  name: string;
  /** Beside the link: before it what picks the row, after it what can be done with it. */
  pick?: ComponentChildren;
  actions?: ComponentChildren;
  /** Folded beneath the row. */
  under?: Row[];
}

export interface Filter {
  q: string;
  robot: string;
  verdict: Usability | "";
  state: keyof typeof text.states | "all" | "deleted";
  sort: keyof typeof words.sorts;
  /** Days between which it was measured. */
  from: string;
  to: string;
}

const NONE: Filter = { q: "", robot: "", verdict: "", state: "all", sort: "newest", from: "", to: "" };

/** What of a filter is not usual, as an address says it. */
const unusual = (filter: Filter): Record<string, string> =>
  Object.fromEntries(Object.entries(filter).filter(([name, value]) => value !== NONE[name as keyof Filter]));

const filterIn = (query: URLSearchParams): Filter => ({
  ...NONE,
  ...Object.fromEntries([...query].filter(([name, value]) => name in NONE && value)),
});

type FilterState = [Filter, (part: Partial<Filter>) => void];

/** The filter that the address of a view states: the address and the list cannot differ. */
function useFilterOfAddress(query: URLSearchParams): FilterState {
  const change = (part: Partial<Filter>) =>
    readdress((now) => {
      const others = Object.fromEntries([...now].filter(([name]) => !(name in NONE)));
      return { ...others, ...unusual({ ...filterIn(now), ...part }) };
    });
  return [filterIn(query), change];
}

/** The filter of a list whose view has an address of its own: *Back* brings the filter back. */
function useFilterOfEntry(): FilterState {
  const [filter, put] = useKeptOnEntry<Filter>("filter", NONE);
  return [filter, (part) => put((before) => ({ ...before, ...part }))];
}

/** A filter; `query`: that of the address, if the list is the view. */
export function useFilter(query?: URLSearchParams): FilterState {
  const ofEntry = useFilterOfEntry();
  const ofAddress = useFilterOfAddress(query ?? new URLSearchParams());
  return query ? ofAddress : ofEntry;
}

const ORDERS = { newest: "-created_at", oldest: "created_at", name: "name" } as const;

/** Search and order of a filter, as the service takes them. */
export const wanted = ({ q, sort }: Filter) => ({ q: q.trim() || null, sort: ORDERS[sort] });

/** What a list shows: words, and robot and verdict where `robots` and `judged` give a choice. */
export function FilterBar({
  filter,
  change,
  robots = false,
  judged = false,
  label = words.search,
  children,
}: {
  filter: Filter;
  change: (part: Partial<Filter>) => void;
  robots?: boolean;
  judged?: boolean;
  label?: string;
  children?: ComponentChildren;
}) {
  const [typed, setTyped] = useTyped(filter.q, (q) => change({ q }));
  return (
    <div class="filters">
      <TextField type="search" label={label} placeholder={words.searchHint} value={typed} change={setTyped} />
      <Folded label={words.filter}>
        {robots && (
          <RobotSelect
            label={text.start.robot}
            value={filter.robot}
            change={(robot) => change({ robot })}
            none={text.app.all}
            several
          />
        )}
        {judged && (
          <Select
            label={text.run.verdict}
            value={filter.verdict}
            change={(verdict) => change({ verdict: verdict as Usability | "" })}
            options={[
              { value: "", label: text.assessment.any },
              ...Object.entries(text.usability).map(([value, label]) => ({ value, label })),
            ]}
          />
        )}
        {children}
        <Select
          label={words.sort}
          value={filter.sort}
          change={(sort) => change({ sort: sort as Filter["sort"] })}
          options={Object.entries(words.sorts).map(([value, label]) => ({ value, label }))}
        />
      </Folded>
    </div>
  );
}

/** Arrow keys go from row to row. */
function walk(event: KeyboardEvent): void {
  const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
  const links = [...(event.currentTarget as HTMLElement).querySelectorAll<HTMLElement>("a.main")];
  const at = links.findIndex((link) => link === document.activeElement);
  if (step === undefined || at < 0) return;
  event.preventDefault();
  links[at + step]?.focus();
}

export function Rows({ rows }: { rows: Row[] }) {
  return (
    <ul class="rows" onKeyDown={walk}>
      {rows.map((row) => (
        <li key={row.id}>
          <Item row={row} />
          {row.under && row.under.length > 0 && (
            <details class="variants">
              <summary>{text.assessment.variants(row.under.length)}</summary>
              {row.under.map((each) => (
                <Item key={each.id} row={each} />
              ))}
            </details>
          )}
        </li>
      ))}
    </ul>
  );
}

function Item({ row }: { row: Row }) {
  const cells = (
    <>
      <span class="what" title={row.name}>
        <Name>{row.name}</Name>
        {row.note && <small>{row.note}</small>}
      </span>
      {row.how && <span class="how">{row.how}</span>}
      {row.figures}
      {row.at !== undefined && <span class="when">{row.at === null ? text.never : <When time={row.at} />}</span>}
      {row.standing && <span class="standing">{row.standing}</span>}
    </>
  );
  return (
    <div class="item">
      {row.pick}
      {row.href === undefined ? (
        <div class="main">{cells}</div>
      ) : (
        <a class="main" href={row.href}>
          {cells}
        </a>
      )}
      {row.actions}
    </div>
  );
}
