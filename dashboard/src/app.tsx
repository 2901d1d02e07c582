/** The frame of the page: header, the view of the address, messages; signing in before it. */
import type { FunctionComponent } from "preact";
import { useEffect, useLayoutEffect, useState, useRef } from "preact/hooks";
import { api } from "./api/calls";
import type { Session } from "./api/types";
import {
  Busy,
  Form,
  Prose,
  Title,
  Tip,
  Button,
  Choice,
  Empty,
  Icon,
  LinkButton,
  Boundary,
  lazy,
} from "./components/basics";
import { TextField, Select } from "./components/fields";
import { useAction, go, type Route, useRoute, dismiss, toast, useToasts } from "./state/action";
import { goToPlace, keepPlaces } from "./state/entry";
import { text } from "./words";
import { listen } from "./lib/events";
import { STIFFNESS_UNITS, type StiffnessUnit, UNIT_NAMES } from "./lib/stiffness";
import { useQuestion } from "./state/question";
import {
  type Standing,
  Viewer,
  isViewer,
  needsKey,
  signOut,
  useSession,
  type Settings,
  SettingsContext,
  THEMES,
  type Theme,
  useStoredSettings,
} from "./state/session";

/** `link`: secret of a one-time link, which leaves the address before it is used. */
export function SignInView({ link, signedIn }: { link: string | undefined; signedIn: (session: Session) => void }) {
  const [key, setKey] = useState("");
  const { run, busy, problem } = useAction(async (secret: { key: string } | { link: string }) => {
    const session = await api.signIn(secret);
    if (location.hash.startsWith("#/sign-in")) go("#/");
    signedIn(session);
  });
  useEffect(() => {
    if (link === undefined) return;
    history.replaceState(history.state, "", "#/sign-in");
    run({ link });
  }, [link]);
  const enter = { run: () => void (key.trim() && run({ key: key.trim() })), busy, problem };
  const { signIn: words } = text;
  return (
    <>
      <Title plain={words.title}>{words.title}</Title>
      <Form action={enter} class="card form">
        <p>
          <Prose text={words.hint} />
        </p>
        <TextField type="password" label={words.key} maxLength={200} value={key} placeholder="jst_…" change={setKey} />
        {busy && <Busy label={words.checking} />}
        <button type="submit" class="button primary" disabled={busy || !key.trim()}>
          {words.title}
        </button>
      </Form>
    </>
  );
}

const QuestionDialog = lazy(async () => (await import("./components/question")).QuestionDialog);
const StartView = lazy(async () => (await import("./features/start/view")).StartView);
const RunsView = lazy(async () => (await import("./features/runs/view")).RunsView);
const RunView = lazy(async () => (await import("./features/run/view")).RunView);
const CompareView = lazy(async () => (await import("./features/compare/view")).CompareView);
const SideBySideView = lazy(async () => (await import("./features/compare/view")).SideBySideView);
const ComparisonView = lazy(async () => (await import("./features/compare/view")).ComparisonView);
const TrendView = lazy(async () => (await import("./features/trend/view")).TrendView);
const MapView = lazy(async () => (await import("./features/use/results")).MapView);
const CorrectionView = lazy(async () => (await import("./features/use/results")).CorrectionView);
const RobotsView = lazy(async () => (await import("./features/robots/view")).RobotsView);
const RobotView = lazy(async () => (await import("./features/robots/view")).RobotView);
const RobotNewView = lazy(async () => (await import("./features/robots/new")).RobotNewView);
const SetView = lazy(async () => (await import("./features/robots/view")).SetView);
const GearboxesView = lazy(async () => (await import("./features/gearbox/view")).GearboxesView);
const GearboxView = lazy(async () => (await import("./features/gearbox/view")).GearboxView);
const WallView = lazy(async () => (await import("./features/wall/view")).WallView);
const PlansView = lazy(async () => (await import("./features/plan/view")).PlansView);
const PlanView = lazy(async () => (await import("./features/plan/view")).PlanView);
const MeasureView = lazy(async () => (await import("./features/measure/view")).MeasureView);
const LiveView = lazy(async () => (await import("./features/measure/live_view")).LiveView);

const SECTIONS = [
  { id: "", label: text.app.measure, icon: "M12 4v16M4 12h16" },
  { id: "runs", label: text.app.runs, icon: "M4 6h16M4 12h16M4 18h10" },
  { id: "compare", label: text.app.compare, icon: "M6 20V10M12 20V4M18 20v-7" },
  { id: "robots", label: text.app.robots, icon: "M5 20h8M9 20v-6l6-7 4 4" },
] as const;

export function App() {
  const settings = useStoredSettings();
  const route = useRoute();
  const [session, setSession] = useSession();
  const isLink = route.parts[0] === "sign-in" && route.parts[1] !== undefined;
  const main = useRef<HTMLElement>(null);
  const address = route.parts.join("/");
  const first = useRef(true);
  useEffect(keepPlaces, []);
  const isWide = hasArm(route);
  useLayoutEffect(() => {
    document.documentElement.toggleAttribute("data-wide", isWide);
  }, [isWide]);
  useEffect(() => {
    goToPlace();
    if (!first.current) {
      main.current?.querySelector("h1")?.focus({ preventScroll: true });
    }
    first.current = false;
  }, [address]);
  const toContent = (event: Event) => {
    event.preventDefault(); // the address after # is the route
    main.current?.focus();
  };
  return (
    <SettingsContext.Provider value={settings}>
      <a class="skip" href="#content" onClick={toContent}>
        {text.app.skip}
      </a>
      <Header section={sectionOf(route)} settings={settings} session={session} />
      {isViewer(session) && <p class="note viewer">{text.signIn.viewer}</p>}
      {typeof session === "object" && session.access === "none" && <p class="note warn">{text.app.noAccessControl}</p>}
      <main id="content" tabIndex={-1} ref={main}>
        <Boundary key={viewKey(route)}>
          {session === "unknown" ? (
            <Busy />
          ) : needsKey(session) || isLink ? (
            <SignInView link={isLink ? route.parts[1] : undefined} signedIn={setSession} />
          ) : (
            <Viewer.Provider value={isViewer(session)}>
              <View route={route} />
            </Viewer.Provider>
          )}
        </Boundary>
      </main>
      <Toasts />
      {useQuestion() && <QuestionDialog />}
      <Tip />
    </SettingsContext.Provider>
  );
}

/** What an address says beside its section. */
interface Place {
  id: string;
  part: string;
  query: URLSearchParams;
}

const OneRobot = ({ id }: Place) => (id === "new" ? <RobotNewView /> : <RobotView id={id} />);

/** What has no id, what has one, and the section in the header where that is another one. */
const VIEWS = new Map<string, [FunctionComponent<Place>, FunctionComponent<Place>, string?]>([
  ["", [StartView, StartView]],
  ["runs", [RunsView, RunView]],
  ["corrections", [RunsView, CorrectionView, "runs"]],
  ["maps", [RunsView, MapView, "runs"]],
  ["sets", [({ query }) => <RobotsView list="sets" query={query} />, SetView, "robots"]],
  ["gearboxes", [GearboxesView, GearboxView, "robots"]],
  ["wall", [WallView, WallView, "robots"]],
  ["plans", [PlansView, PlanView, "robots"]],
  ["measure", [MeasureView, LiveView, ""]],
  ["robots", [({ query }) => <RobotsView list="robots" query={query} />, OneRobot]],
  ["compare", [Compared, Compared]],
]);

const sectionOf = ({ parts: [first = ""] }: Route): string => VIEWS.get(first)?.[2] ?? first;

/** Whether the view has an arm beside its numbers, for which a wide window has room. */
const hasArm = ({ parts: [section = "", id] }: Route): boolean =>
  id !== undefined && ["runs", "maps", "corrections"].includes(section);

/** Parts of one run are one view, which keeps what it has loaded. */
const viewKey = ({ parts }: Route): string => (parts[0] === "runs" ? parts.slice(0, 2) : parts).join("/");

function View({ route: { parts, query } }: { route: Route }) {
  const [section = "", id = "", part = ""] = parts;
  const [Several, One] = VIEWS.get(section) ?? [Lost, Lost];
  return id ? <One {...{ id, part, query }} /> : <Several {...{ id, part, query }} />;
}

function Compared({ id: kind, part: id, query }: Place) {
  if (kind === "runs") return <SideBySideView ids={(query.get("ids") ?? "").split(",").filter(Boolean)} />;
  if ((kind === "methods" || kind === "pairs") && id) return <ComparisonView id={id} />;
  if (kind === "trend")
    return id ? (
      <TrendView key={query.get("serial")} robot={id} serial={query.get("serial")} />
    ) : (
      <RobotsView list="robots" query={query} />
    );
  return <CompareView kind={kind || "methods"} />;
}

function Lost() {
  return (
    <>
      <Title plain={text.app.notFound}>{text.app.notFound}</Title>
      <Empty title={text.app.notFound} hint={text.app.notFoundHint}>
        <LinkButton href="#/runs">{text.app.runs}</LinkButton>
      </Empty>
    </>
  );
}

interface HeaderProps {
  section: string;
  settings: Settings;
  session: Standing;
}

function Header({ section, settings, session }: HeaderProps) {
  return (
    <header class="header">
      <a class="brand" href="#/">
        <svg viewBox="0 0 32 32" aria-hidden="true">
          <path d="M7 26h10M12 26V16L22 7" />
          <circle cx="12" cy="16" r="3.4" />
          <circle cx="22" cy="7" r="3.4" />
        </svg>
        {text.app.name}
      </a>
      <nav class="sections" aria-label={text.app.navigation}>
        {SECTIONS.map((item) => (
          <a href={`#/${item.id}`} aria-current={item.id === section ? "page" : undefined}>
            <Icon d={item.icon} />
            <span>{item.label}</span>
          </a>
        ))}
      </nav>
      <a class="docs" href="docs/" aria-label={text.app.docs}>
        <Icon d="M5 4h10a4 4 0 0 1 4 4v12H9a4 4 0 0 1-4-4zM9 9h6M9 13h6" />
        <span>{text.app.docs}</span>
      </a>
      <Display settings={settings} session={session} />
    </header>
  );
}

function Display({ settings, session }: { settings: Settings; session: Standing }) {
  const details = useRef<HTMLDetailsElement>(null);
  useEffect(() => {
    const close = () => {
      if (details.current) details.current.open = false;
    };
    return listen(window, {
      pointerdown: ({ target }: PointerEvent) => details.current?.contains(target as Node) || close(),
      keydown: ({ key }: KeyboardEvent) => key === "Escape" && close(),
      hashchange: close,
    });
  }, []);
  return (
    <details class="display" ref={details}>
      <summary aria-label={text.app.settings}>
        <Icon d="M4 7h10M18 7h2M4 17h2M10 17h10M13.8 7a2.2 2.2 0 1 0 4.4 0a2.2 2.2 0 1 0-4.4 0M5.8 17a2.2 2.2 0 1 0 4.4 0a2.2 2.2 0 1 0-4.4 0" />
        <span>{text.app.settings}</span>
      </summary>
      <div class="panel">
        <Choice
          label={text.app.theme}
          value={settings.theme}
          change={(theme: Theme) => settings.change({ theme })}
          options={THEMES.map((value) => ({ value, label: text.app.themes[value] }))}
        />
        <Select
          label={text.app.unit}
          value={settings.unit}
          change={(unit) => settings.change({ unit: unit as StiffnessUnit })}
          options={UNIT_NAMES.map((value) => ({ value, label: STIFFNESS_UNITS[value].label }))}
        />
        {typeof session === "object" && session.key_name !== null && (
          <>
            <p>{text.signIn.as(session.key_name, session.role ?? "")}</p>
            <Button onClick={() => void signOut().catch(() => toast(text.signIn.stuck))}>{text.signIn.out}</Button>
          </>
        )}
      </div>
    </details>
  );
}

function Toasts() {
  const toasts = useToasts();
  return (
    <div class="toasts" role="status" aria-live="polite">
      {toasts.map(({ id, message, action }) => (
        <div class="toast" key={id}>
          <span>{message}</span>
          {action && (
            <Button
              onClick={() => {
                action.run();
                dismiss(id);
              }}
            >
              {action.label}
            </Button>
          )}
          <Button look="quiet close" aria-label={text.app.close} onClick={() => dismiss(id)}>
            ×
          </Button>
        </div>
      ))}
    </div>
  );
}
