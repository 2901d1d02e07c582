/** The small parts all views are made of. */
import { type RefObject, type ComponentChildren, type ComponentProps, Component, type FunctionComponent } from "preact";
import { useLayoutEffect, useRef, useState, useEffect, useContext, useId } from "preact/hooks";
import { go, type Action, hasNavigated, link, toast } from "../state/action";
import { text } from "../words";
import type { Problem, Finding, RunState, Usability } from "../api/types";
import { recalled, remember } from "../state/kept";
import { type Query, send } from "../state/query";
import { Viewer } from "../state/session";
import { listen } from "../lib/events";
import { dayText, roughTime, timeText, zonedText } from "../lib/format";
import { groupedBy } from "../lib/json";
import { fieldName, roundedP, onPage, placeName, sentence } from "../lib/said";
import { api } from "../api/calls";
import { problemOf } from "../api/problem";

export function useWidth<Box extends HTMLElement>(): [RefObject<Box | null>, number] {
  const element = useRef<Box | null>(null);
  const [width, set] = useState(0);
  useLayoutEffect(() => {
    const watched = element.current;
    if (!watched) return undefined;
    set(Math.floor(watched.clientWidth));
    const observer = new ResizeObserver(([entry]) => entry && set(Math.floor(entry.contentRect.width)));
    observer.observe(watched);
    return () => observer.disconnect();
  }, []);
  return [element, width];
}

interface Shown {
  mark: Element;
  /** A finger has no hover: what it touched offers its link. */
  touched: boolean;
}

const GAP = 14;

/** Attributes of a mark: a heading, values, and where a click on it leads. */
export function tip(lines: string[], open?: string | null): { "data-tip": string; "data-open"?: string } {
  return { "data-tip": lines.join("\n"), ...(open ? { "data-open": open } : {}) };
}

const markAt = (event: Event): Element | null =>
  event.target instanceof Element ? event.target.closest("[data-tip]") : null;

/** Stands once, at the end of the page. */
export function Tip() {
  const [shown, show] = useState<Shown | null>(null);
  const box = useRef<HTMLDivElement>(null);
  const at = useRef<[number, number]>([0, 0]);
  useEffect(() => {
    const look = (mark: Element | null, x: number, y: number, touched = false) => {
      at.current = [x, y];
      show((before) => (before?.mark === mark && !touched ? before : mark && { mark, touched }));
      place(box.current, at.current);
    };
    const hide = () => show(null);
    return listen(window, {
      pointermove: (event: PointerEvent) => {
        if (event.pointerType !== "touch") look(markAt(event), event.clientX, event.clientY);
      },
      pointerdown: (event: PointerEvent) => {
        if (event.pointerType === "touch" && !box.current?.contains(event.target as Node))
          look(markAt(event), event.clientX, event.clientY, true);
      },
      click: (event: PointerEvent) => {
        const open = markAt(event)?.getAttribute("data-open");
        if (open && event.pointerType !== "touch") go(open);
      },
      focusin: (event: FocusEvent) => {
        if (!(event.target instanceof Element && event.target.matches(":focus-visible"))) return; // a tap, not a key
        const { left, bottom } = event.target.getBoundingClientRect();
        look(markAt(event), left, bottom - GAP + 6);
      },
      hashchange: hide,
      scroll: hide,
    });
  }, []);
  useEffect(() => place(box.current, at.current), [shown]);
  if (!shown) return null;
  const { mark, touched } = shown;
  const [heading, ...values] = (mark.getAttribute("data-tip") ?? "").split("\n");
  const open = mark.getAttribute("data-open");
  return (
    <div class={touched ? "tip touched" : "tip"} ref={box} aria-hidden={!touched}>
      <b>{heading}</b>
      {values.map((value) => (
        <span>{value}</span>
      ))}
      {open && (touched ? <a href={open}>{text.figure.open}</a> : <small>{text.figure.clickToOpen}</small>)}
    </div>
  );
}

/** Beside the pointer, inside the window. */
function place(box: HTMLElement | null, [x, y]: [number, number]): void {
  if (!box) return;
  const { offsetWidth: width, offsetHeight: height } = box;
  const left = x + GAP + width > innerWidth - 8 ? x - GAP - width : x + GAP;
  const top = y + GAP + height > innerHeight - 8 ? y - GAP - height : y + GAP;
  box.style.left = `${Math.max(8, left)}px`;
  box.style.top = `${Math.max(8, top)}px`;
}

/** A name that someone else chose: text, isolated from what is around it. */
export function Name({ children }: { children: string }) {
  return <bdi class="name">{children}</bdi>;
}

/** A drawing of lines beside a word that says the same. */
export const Icon = ({ d }: { d: string }) => (
  <svg viewBox="0 0 24 24" aria-hidden="true">
    <path d={d} />
  </svg>
);

/** A name that leads to what has it. */
export const NameLink = ({ to, children }: { to: string[]; children: string }) => (
  <a href={link(to)}>
    <Name>{children}</Name>
  </a>
);

/** Text of the service or of ours; what stands between backticks is code, or a field that has a name here. */
export function Prose({ text: prose }: { text: string }) {
  return (
    <>
      {roundedP(prose)
        .split(/`([^`]+)`/)
        .map((part, i) => (i % 2 ? <Code>{part}</Code> : part))}
    </>
  );
}

const Code = ({ children }: { children: string }) => {
  const name = fieldName(children);
  return name === undefined ? <code>{children}</code> : <>“{name}”</>;
};

/** The heading of a view; it takes the focus when one comes to the view, and names the browser's tab. */
export function Title({ kind, children, plain }: { kind?: string; children: ComponentChildren; plain: string }) {
  const heading = useRef<HTMLHeadingElement>(null);
  useEffect(() => {
    document.title = `${plain} · ${text.app.name}`;
  }, [plain]);
  useEffect(() => {
    const free = document.activeElement === document.body || document.activeElement === null;
    if (free && hasNavigated()) heading.current?.focus({ preventScroll: true });
  }, []);
  return (
    <div class="title">
      {kind !== undefined && <p class="kind">{kind}</p>}
      <h1 ref={heading} tabIndex={-1} title={plain}>
        {children}
      </h1>
    </div>
  );
}

/** Whether the page is as narrow as a phone. */
export const usePhone = (): boolean => useMedia(PHONE);

/** Whether the arm of a result has room beside the numbers, as the style sheet has it. */
export const useArmBeside = (): boolean => useMedia("(min-width: 1200px)");

function useMedia(query: string): boolean {
  const [matches, set] = useState(() => matchMedia(query).matches);
  useEffect(() => {
    const media = matchMedia(query);
    return listen(media, { change: () => set(media.matches) });
  }, []);
  return matches;
}

interface FoldedProps {
  label: string;
  /** Widths that have no room for it. */
  at?: string;
  children: ComponentChildren;
}

/** What is folded away on a phone, and in view elsewhere. */
export function Folded({ label, at = PHONE, children }: FoldedProps) {
  if (!useMedia(at)) return <>{children}</>;
  return (
    <details class="folded">
      <summary>{label}</summary>
      <div>{children}</div>
    </details>
  );
}

const PHONE = "(max-width: 640px)";
const UPRIGHT = "(max-width: 900px)";

interface HeadProps {
  kind?: string;
  plain: string;
  title?: ComponentChildren;
  about?: ComponentChildren;
  first?: ComponentChildren;
  /** Widths at which what else there is is folded away. */
  fold?: string;
  children?: ComponentChildren;
}

/** The head of a view: its title, what it is about, the first thing to do, and what else there is. */
export const Head = ({ kind, plain, title = plain, about, first, fold = UPRIGHT, children }: HeadProps) => (
  <div class="head">
    <Title plain={plain} {...(kind === undefined ? {} : { kind })}>
      {title}
    </Title>
    {about && <p class="meta">{about}</p>}
    {(first || children) && (
      <div class="actions">
        {first}
        {children && (
          <Folded label={text.app.further} at={fold}>
            {children}
          </Folded>
        )}
      </div>
    )}
  </div>
);

/** Its rank, and what is told apart by the style sheet. */
interface Looks {
  look?: "primary" | "primary big" | "quiet" | "quiet icon" | "quiet close" | "quiet back" | "bad";
}

const classOf = (look?: string): string => (look ? `button ${look}` : "button");

/** What `acts` is disabled for a viewer, and says why. */
export function Button({ look, acts, disabled, ...rest }: Looks & { acts?: boolean } & ComponentProps<"button">) {
  const forbidden = useContext(Viewer) && acts === true;
  const why = forbidden ? { title: text.signIn.viewer } : {};
  return <button type="button" class={classOf(look)} disabled={Boolean(disabled) || forbidden} {...rest} {...why} />;
}

interface ActionProps extends Omit<ComponentProps<typeof Button>, "action"> {
  action: Action<[]>;
  going?: string;
  /** What must be done before it can begin; null if nothing. */
  lacking?: string | null;
}

/** The button of an action: it waits while the action goes on, below what went wrong the last time. */
export const ActionButton = ({ action, going, disabled, lacking = null, children, ...rest }: ActionProps) => (
  <>
    {action.problem && <ProblemNote problem={action.problem} />}
    <Button acts disabled={action.busy || Boolean(disabled) || lacking !== null} onClick={action.run} {...rest}>
      {action.busy && going ? going : children}
    </Button>
    {lacking !== null && <span class="soft">{lacking}</span>}
    {action.busy && <Waiting took={action.took ?? null} />}
  </>
);

/** How long an answer takes that comes without steps, by how long the last one took. */
function Waiting({ took }: { took: number | null }) {
  const [seconds, set] = useState(0);
  useEffect(() => {
    const timer = setInterval(() => set((before) => before + 1), 1000);
    return () => clearInterval(timer);
  }, []);
  if (seconds < 2) return null;
  const left = took === null ? 0 : took - seconds;
  return (
    <>
      <span class="hidden" role="status">
        {text.run.progress}
      </span>
      {took !== null && left > 0 ? (
        <ProgressBar done={seconds} total={took}>
          {text.run.left(roughTime(left))}
        </ProgressBar>
      ) : (
        <ProgressBar>{text.run.since(roughTime(seconds))}</ProgressBar>
      )}
    </>
  );
}

interface ProgressBarProps {
  done?: number;
  total?: number;
  children?: string;
}

/** How far something long has come; without a total it only moves. */
export const ProgressBar = ({ done, total, children }: ProgressBarProps) => (
  <span class="progress">
    <progress aria-label={text.run.progress} {...(total === undefined ? {} : { value: done, max: total })} />
    {children && <small>{children}</small>}
  </span>
);

interface FormProps {
  action: Action<[]>;
  class?: string;
  children: ComponentChildren;
}

/** Fields of an action, which the Enter key begins, too. */
export const Form = ({ action, class: look = "row", children }: FormProps) => (
  <form
    class={look}
    onSubmit={(event) => {
      event.preventDefault();
      action.run();
    }}
  >
    {children}
    {action.problem && <ProblemNote problem={action.problem} />}
  </form>
);

/** A file to take along. */
export const Download = (of: ComponentProps<typeof LinkButton>) => <LinkButton download {...of} />;

/** A way to another place that looks like a button. */
export const LinkButton = ({ look, ...rest }: Looks & ComponentProps<"a">) => <a class={classOf(look)} {...rest} />;

export function Busy({ label = text.app.loading }: { label?: string }) {
  return (
    <p class="busy" role="status">
      <span class="spinner" aria-hidden="true" />
      {label}
    </p>
  );
}

/** What of a problem is said. */
type Said = Pick<Problem, "title" | "detail"> & Partial<Problem>;

interface NoteProps {
  problem: Said;
  retry?: () => void;
  /** Brings back what was deleted, in place of the remedy that says how. */
  restore?: (() => Promise<unknown>) | undefined;
}

/** A refusal: what, where, what to do; faults that are listed are said there alone. */
export function ProblemNote({ problem, retry, restore }: NoteProps) {
  const listed = problem.errors?.some(({ reason }) => problem.detail.endsWith(reason));
  return (
    <div class="note bad" role="alert">
      <h2>{problem.title}</h2>
      {!listed && (
        <p>
          <Prose text={sentence(problem.detail)} />
        </p>
      )}
      {problem.where && !listed && (
        <p>
          <b>{text.errors.where}:</b> <Code>{problem.where}</Code>
        </p>
      )}
      {problem.remedy && !restore && (
        <p>
          <b>{text.errors.remedy}:</b> <Prose text={sentence(onPage(problem.remedy))} />
        </p>
      )}
      {problem.errors && problem.errors.length > 0 && (
        <ul>
          {problem.errors.slice(0, 8).map(({ where, reason, remedy }) => (
            <li>
              <Code>{where}</Code>{" "}
              <Prose text={remedy && remedy !== problem.remedy ? `${reason}: ${remedy}` : reason} />
            </li>
          ))}
        </ul>
      )}
      {restore ? (
        <Button look="primary" onClick={() => void send(restore).then(retry, failed)} acts>
          {text.lists.restore}
        </Button>
      ) : (
        retry && <Button onClick={retry}>{text.app.retry}</Button>
      )}
    </div>
  );
}

const failed = (error: unknown) => toast(problemOf(error).detail);

/** Whether a problem is that of something deleted, which can be restored. */
const isDeleted = ({ type }: Problem): boolean => type.endsWith(":deleted");

/** Findings of one kind stand together. */
export const alikeOf = (findings: Finding[]): Finding[][] => [
  ...groupedBy(findings, ({ code, remedy }) => `${code}\n${remedy}`).values(),
];

/** Of one kind, this many are said before the rest is folded away. */
const SAID = 2;

/** Findings and warnings: those of one kind together, with their remedy once. */
export function Warnings({ warnings }: { warnings: Finding[] }) {
  return (
    <ul class="warnings">
      {alikeOf(warnings).map((kind) => (
        <li class="note warn">
          {kind.slice(0, SAID).map((warning) => (
            <Seen warning={warning} />
          ))}
          {kind.length > SAID && (
            <details>
              <summary>{text.files.moreOfKind(kind.length - SAID)}</summary>
              {kind.slice(SAID).map((warning) => (
                <Seen warning={warning} />
              ))}
            </details>
          )}
          <p class="remedy">
            <b>{text.errors.remedy}:</b> <Prose text={kind[0]?.remedy ?? ""} />
          </p>
        </li>
      ))}
    </ul>
  );
}

/** A finding or a reason, with its place. */
export const Seen = ({ warning }: { warning: { where: string | null; message: string } }) => (
  <p>
    {warning.where && (
      <b>
        <bdi>{placeName(warning.where)}</bdi>:
      </b>
    )}{" "}
    <Prose text={warning.where ? warning.message : sentence(warning.message)} />
  </p>
);

export function Empty({ title, hint, children }: { title: string; hint: string; children?: ComponentChildren }) {
  return (
    <div class="empty">
      <h2>{title}</h2>
      <p>{hint}</p>
      {children}
    </div>
  );
}

/** The way to what fills an empty list. */
export const MeasureLink = ({ robot }: { robot?: string }) => (
  <LinkButton look="primary" href={link([], robot === undefined ? {} : { robot })}>
    {text.app.measure}
  </LinkButton>
);

interface ShowProps<Value> {
  of: Query<Value>;
  title?: string;
  /** Brings back what was deleted. */
  restore?: () => Promise<unknown>;
  /** Shown in its place, where there is nothing in it. */
  instead?: (value: Value) => ComponentChildren;
  children: (value: Value) => ComponentChildren;
}

/** What was loaded, or why not; `title` heads the view until what was loaded brings its own. */
export function Show<Value>({ of, title, restore, instead, children }: ShowProps<Value>) {
  if (of.data !== undefined) return <>{instead?.(of.data) || children(of.data)}</>;
  return (
    <>
      {title !== undefined && <Title plain={title}>{title}</Title>}
      {of.problem ? (
        <ProblemNote problem={of.problem} retry={of.refetch} restore={isDeleted(of.problem) ? restore : undefined} />
      ) : (
        <Busy />
      )}
    </>
  );
}

export function State({ state }: { state: RunState }) {
  return <span class={`state ${state}`}>{text.states[state]}</span>;
}

export interface Fact {
  label: ComponentChildren;
  value: ComponentChildren;
}

/** Labels with their values; what is no fact is left out. */
export function Facts({ facts, wide = false }: { facts: (Fact | false | null | undefined | "")[]; wide?: boolean }) {
  return (
    <dl class={wide ? "facts wide" : "facts"}>
      {facts.map(
        (fact) =>
          fact && (
            <div>
              <dt>{fact.label}</dt>
              <dd>{fact.value}</dd>
            </div>
          ),
      )}
    </dl>
  );
}

interface Option<Value extends string> {
  value: Value;
  label: string;
  hint?: string;
  disabled?: boolean;
}

/** Options, or their labels by value. */
export type Options<Value extends string> = Option<Value>[] | Record<Value, string>;

export const optionsOf = <Value extends string>(options: Options<Value>): Option<Value>[] =>
  Array.isArray(options)
    ? options
    : (Object.entries(options) as [Value, string][]).map(([value, label]) => ({ value, label }));

interface ChoiceProps<Value extends string> {
  label: string;
  options: Options<Value>;
  value: Value;
  change: (value: Value) => void;
  look?: "choice" | "choice cards" | "choice cards arms";
}

/** One of a few, all in view: radio buttons that look like what they are for. */
export function Choice<Value extends string>({ label, options, value, change, look = "choice" }: ChoiceProps<Value>) {
  const name = useId();
  return (
    <fieldset class={look}>
      <legend>{label}</legend>
      <div class="options">
        {optionsOf(options).map((option) => (
          <label class="option">
            <input
              type="radio"
              name={name}
              value={option.value}
              checked={option.value === value}
              disabled={option.disabled ?? false}
              onChange={() => change(option.value)}
            />
            <span>
              <b>{option.label}</b>
              {option.hint !== undefined && <small>{option.hint}</small>}
            </span>
          </label>
        ))}
      </div>
    </fieldset>
  );
}

interface ToggleProps {
  label: string;
  checked: boolean;
  change: (checked: boolean) => void;
}

export function Toggle({ label, checked, change }: ToggleProps) {
  return (
    <label class="toggle">
      <input type="checkbox" checked={checked} onChange={(event) => change(event.currentTarget.checked)} />
      <span>{label}</span>
    </label>
  );
}

interface TabsProps {
  label: string;
  tabs: { href: string; label: string; id: string }[];
  current: string;
}

/** Links between the parts of a view. */
export function Tabs({ label, tabs, current }: TabsProps) {
  const row = useRef<HTMLElement>(null);
  useEffect(() => {
    const at = row.current?.querySelector<HTMLElement>("[aria-current]");
    row.current?.scrollTo({ left: (at?.offsetLeft ?? 0) - row.current.clientWidth / 2 }); // the current one is in view
  }, [current]);
  return (
    <nav class="tabs" aria-label={label} ref={row}>
      {tabs.map((tab) => (
        <a href={tab.href} aria-current={tab.id === current ? "page" : undefined}>
          {tab.label}
        </a>
      ))}
    </nav>
  );
}

export function When({ time }: { time: string }) {
  const day = dayText(time);
  return (
    <time dateTime={time} title={zonedText(time)}>
      {day}
      <span class="hour">{timeText(time).slice(day.length)}</span>
    </time>
  );
}

const ICONS: Record<Usability, string> = {
  use: "M5 12.5l4.5 4.5L19 7.5",
  use_with_care: "M12 4L2.8 20h18.4zM12 10v4.5M12 17.2v.3",
  do_not_use: "M6 6l12 12M18 6L6 18",
};

export function Badge({ verdict, large = false }: { verdict: Usability; large?: boolean }) {
  return (
    <span class={`badge ${verdict}${large ? " large" : ""}`}>
      <Icon d={ICONS[verdict]} />
      {text.usability[verdict]}
    </span>
  );
}

type Known = keyof typeof text.glossary;

export function Term({ of, children }: { of: Known; children?: string }) {
  const shown = children ?? text.glossary[of][0];
  return (
    <span class="term" tabIndex={0} {...tip([...text.glossary[of]])}>
      {shown}
    </span>
  );
}

/** As long as the service is away, it is asked again after this time. */
const AGAIN_MS = 4_000;
const RELOADED = "reloaded";

/** Load the page again, once within a minute: what was typed is kept. */
function reloadOnce(): void {
  if (Date.now() - Number(recalled(RELOADED, "sessionStorage") ?? 0) < 60_000) return;
  remember(RELOADED, Date.now(), "sessionStorage");
  location.reload();
}

/**
 * A view in a module of its own. Where it cannot be loaded, it is tried again once the service answers; after an update
 * of the service its file is another, so that the page is loaded again.
 */
export function lazy<Props extends object>(load: () => Promise<FunctionComponent<Props>>): FunctionComponent<Props> {
  let loaded: FunctionComponent<Props> | null = null;
  return function Lazy(props: Props) {
    const [View, setView] = useState<FunctionComponent<Props> | null>(() => loaded);
    const [failed, setFailed] = useState(false);
    useEffect(() => {
      let timer: ReturnType<typeof setTimeout> | undefined;
      const again = () => {
        timer = setTimeout(() => void api.session().then(() => attempt(reloadOnce), again), AGAIN_MS);
      };
      const attempt = (failing: () => void) =>
        load().then(
          (view) => {
            loaded = view;
            setView(() => view);
            setFailed(false);
          },
          () => {
            setFailed(true);
            failing();
          },
        );
      if (!loaded) void attempt(again);
      return () => clearTimeout(timer);
    }, []);
    if (failed) return <Outdated />;
    return View ? <View {...props} /> : <Busy />;
  };
}

function Outdated() {
  const words = text.errors.outdated;
  return (
    <>
      <Title plain={words.title}>{words.title}</Title>
      <div class="note bad" role="alert">
        <p>{words.detail}</p>
        <Button look="primary" onClick={() => location.reload()}>
          {words.reload}
        </Button>
      </div>
    </>
  );
}

export class Boundary extends Component<{ children: ComponentChildren }, { problem: Problem | null }> {
  override state = { problem: null };

  static override getDerivedStateFromError(error: unknown): { problem: Problem } {
    return { problem: problemOf(error) };
  }

  override render() {
    const { problem } = this.state;
    return problem ? <ProblemNote problem={problem} /> : this.props.children;
  }
}

/** Show what fails where no view waits for it. */
export function reportStrays(): void {
  addEventListener("unhandledrejection", ({ reason }) => toast(problemOf(reason).detail));
}
