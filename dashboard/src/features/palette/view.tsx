/** The command palette: one field that finds robots, sets, runs and actions, by keys alone. */
import { useEffect, useRef, useState } from "preact/hooks";
import { Button, Name } from "../../components/basics";
import { isKnown, useQuery } from "../../state/query";
import { text } from "../../words";
import { actionsOfPage, type Entry, foundEntries, ownEntries } from "./entries";
import { paletteWords as words } from "./words";

/** The service is asked when a person has paused for this time. */
const PAUSE_MS = 150;

function usePaused(typed: string): string {
  const [paused, set] = useState(typed);
  useEffect(() => {
    const timer = setTimeout(() => set(typed), PAUSE_MS);
    return () => clearTimeout(timer);
  }, [typed]);
  return paused;
}

export function Palette({ close }: { close: () => void }) {
  const dialog = useRef<HTMLDialogElement>(null);
  const [actions] = useState(() => actionsOfPage());
  const [typed, setTyped] = useState("");
  const [chosen, setChosen] = useState(0);
  const paused = usePaused(typed);
  const search = useQuery({ queryKey: ["find", paused], queryFn: () => foundEntries(paused) });
  const isSearched = paused === typed && isKnown(search);
  const entries = [...ownEntries(actions, typed), ...(isSearched ? (search.data ?? []) : [])];
  /** Whether somebody pressed Enter before the search had ended. */
  const [entered, setEntered] = useState(false);
  const at = Math.min(chosen, entries.length - 1);
  useEffect(() => {
    const before = document.activeElement;
    dialog.current?.showModal();
    return () => before instanceof HTMLElement && before.focus();
  }, []);
  const take = (entry: Entry | undefined) => {
    if (!entry) return;
    close();
    entry.run();
  };
  useEffect(() => {
    if (!(entered && isSearched)) return;
    setEntered(false);
    take(entries[at]);
  }, [entered, isSearched]);
  const steer = (event: KeyboardEvent) => {
    const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (step === undefined) return;
    event.preventDefault();
    setChosen((at + step + entries.length) % Math.max(1, entries.length));
  };
  return (
    <dialog
      class="card palette"
      ref={dialog}
      aria-label={words.title}
      onCancel={(event) => {
        event.preventDefault();
        close();
      }}
    >
      <form
        onSubmit={(event) => {
          event.preventDefault();
          setEntered(true);
        }}
      >
        <input
          type="text"
          aria-label={words.title}
          placeholder={words.title}
          value={typed}
          onKeyDown={steer}
          onInput={(event) => {
            setTyped(event.currentTarget.value);
            setChosen(0);
            setEntered(false);
          }}
        />
        <Button look="quiet close" aria-label={text.app.close} onClick={close}>
          ×
        </Button>
      </form>
      <ul>
        {entries.map((entry, i) => (
          <li>
            <button type="button" class={i === at ? "chosen" : undefined} onClick={() => take(entry)}>
              <span>
                <Name>{entry.name}</Name> {entry.note && <small class="soft">{entry.note}</small>}
              </span>
              <small class="soft">{words.kinds[entry.kind]}</small>
            </button>
          </li>
        ))}
      </ul>
      {entries.length === 0 && isSearched && <p class="soft">{words.none}</p>}
    </dialog>
  );
}
