/** A campaign while it is measured: one posture a screen, what the readings say so far, and doubts while the weight hangs. */
import type { ComponentChildren } from "preact";
import { useEffect, useRef, useState } from "preact/hooks";
import { api } from "../../api/calls";
import { queries } from "../../api/queries";
import type { JointKind, LiveState, Observation, OpenSet, Robot } from "../../api/types";
import {
  Badge,
  ActionButton,
  Busy,
  Button,
  Head,
  LinkButton,
  lazy,
  Name,
  NameLink,
  ProblemNote,
  Prose,
  Show,
  usePhone,
  Warnings,
} from "../../components/basics";
import { Rows } from "../../components/list";
import { DropZone, understood } from "../../components/schema_form";
import { Select, TextField } from "../../components/fields";
import { SignButton, VectorAxes, VectorBoxes } from "./vector_boxes";
import { understand } from "../../lib/campaign";
import { fixed, percent, significant } from "../../lib/format";
import type { Fields } from "../../lib/json";
import * as live from "./live";
import { type Block, isBlock, type Placed, placed, type Unmatched } from "./paste";
import { sentence } from "../../lib/said";
import { OF_NUMBERS, OF_VECTOR } from "../../lib/schema";
import { position, labelOf, shownWithInterval } from "../../lib/stiffness";
import { Estimate, EstimateBar } from "../../components/estimate";
import { type Vector, norm, times } from "../../lib/vector";
import { ArmView, roomOf } from "../../scene/view";
import { useAction, go, link, toast } from "../../state/action";
import { type Bridge, useBridge, useTracked } from "./bridge";
import { keepPage } from "./device";
import { recalled, remember } from "../../state/kept";
import { useKinematics } from "../../state/kinematics";
import { draftKey, keptIn, useFollowed } from "./live_state";
import { client, keptOnDevice, useQuery } from "../../state/query";
import { discardReading, putState, sendReadings, useWaiting, type Waits as Waited } from "./readings";
import { useSettings } from "../../state/session";
import { askFor, sure } from "../../state/question";
import { text } from "../../words";
import { loadOf, shownJoint } from "../plan/view";
import { TrackerCard, TrackerSaid } from "./tracker";
import { measureWords } from "./words";
import { predictWords } from "../use/words";
import { planWords } from "../plan/words";
import { inUnits, type Stand, standOf } from "../../lib/observation";

const LastResiduals = lazy(async () => (await import("./last_reading")).LastResiduals);
const words = measureWords;
const MAX_BYTES = 8 * 1024 * 1024;

export function LiveView({ id }: { id: string }) {
  const set = useQuery(queries.openSet(id));
  const state = useQuery(queries.liveState(id));
  return (
    <Show of={set} title={words.kind}>
      {(of) => <Show of={state}>{(now) => <Campaign {...of} state={now} />}</Show>}
    </Show>
  );
}

/** A posture that is read instead of the suggested one; `again`: the reading that it repeats. */
type Own = Stand & { again?: string };

function Campaign({ set, robot, state }: { set: OpenSet; robot: Robot; state: LiveState }) {
  const gone = useFollowed(set.id, state.state === "closed");
  const bridge = useBridge(set.id, state.state === "closed");
  const waits = useWaiting(set.id);
  const { waiting } = waits;
  const away = gone || waits.away;
  const send = (...observations: Observation[]) => sendReadings(set.id, observations);
  /** A posture that somebody chose instead of the suggested one. */
  const [own, setOwn] = useState<Own | null>(null);
  const taken = new Set(
    [...state.readings, ...waiting.map(({ observation }) => observation)].map(({ label }) => label),
  );
  useEffect(() => void keepPage().catch(() => undefined), []);
  const planned = usePlanned(set);
  const following = planned.length > 0 ? planned : (state.following ?? []);
  const ahead = following.filter((one) => !taken.has(one.label));
  // Away from the service the plan goes on, or what the service has chosen ahead.
  const suggested = state.next && !taken.has(state.next.label) ? state.next : away ? (ahead[0] ?? null) : null;
  useAhead(robot.id, ahead);
  const stand = own ?? (suggested as Stand | null);
  const label = live.freeLabel(suggested?.label ?? `m${String(taken.size + 1).padStart(2, "0")}`, taken);
  const change = useAction(async (body: Parameters<typeof api.openSets.change>[1]) => {
    await api.openSets.change(set.id, body);
    putState(set.id, await api.openSets.state(set.id));
  });
  const again = async (doubted: string) => {
    const { observations } = await api.openSets.one(set.id);
    const read = observations.find((one) => one.label === doubted);
    change.run({ withdrawn: { [doubted]: words.againReason } });
    if (read) setOwn({ ...standOf(read, set.units, kindsOf(robot)), again: doubted });
  };
  const close = useAction(async () => {
    if (state.state === "measuring" && !(await sure(words.sureToClose))) return;
    const closed = await api.openSets.close(set.id);
    putState(set.id, closed);
    if (closed.run_id) go(link(["runs", closed.run_id]));
  });
  const phone = usePhone(); // its one screen has the posture, the readings and the joints
  const simulated = set.instrument === live.SIMULATED && <p class="note">{words.simulated}</p>;
  const doubts = state.readings.filter((one) => one.state === "doubtful" && state.state !== "closed");
  const reached = state.state === "reached";
  const closing = (big: boolean) => (
    <ActionButton
      look={big ? "primary big" : "quiet"}
      action={close}
      going={text.start.going}
      disabled={waiting.length > 0 || state.readings.length === 0}
    >
      {words.close}
    </ActionButton>
  );
  return (
    <>
      <Head
        kind={words.kind}
        plain={set.name}
        title={<Name>{set.name}</Name>}
        about={
          <>
            {!phone && <NameLink to={["robots", robot.id]}>{robot.name}</NameLink>}
            <span>
              {words.goal}: {state.goal}
            </span>
          </>
        }
        first={!phone && state.state !== "closed" && !(reached && !own) && closing(false)}
      />
      {!phone && simulated}
      <Waits {...{ ...waits, away, taken }} set={set.id} />
      {change.problem && <ProblemNote problem={change.problem} />}
      {doubts.map(({ label: doubted, message, causes }) => (
        <section class="note bad" role="alert" aria-label={words.doubtful(doubted)}>
          <h2>{words.doubtful(doubted)}</h2>
          <p>
            <Prose
              text={sentence(
                [message, ...causes.filter((cause) => !message?.includes(cause))].filter(Boolean).join("; "),
              )}
            />
          </p>
          <div class="row">
            <Button acts look="primary" disabled={change.busy} onClick={() => void again(doubted)}>
              {words.again}
            </Button>
            <Button acts disabled={change.busy} onClick={() => change.run({ kept: [doubted] })}>
              {words.keep}
            </Button>
          </div>
        </section>
      ))}
      {state.state === "closed" ? (
        <section class="card">
          <p class="note good">{words.closed}</p>
          <div class="row">
            {state.run_id && (
              <LinkButton look="primary" href={link(["runs", state.run_id])}>
                {words.closedRun}
              </LinkButton>
            )}
            <LinkButton href={link(["sets", set.id])}>{words.closedSet}</LinkButton>
          </div>
        </section>
      ) : (
        <div class="flow">
          <div>
            {doubts.length > 0 && !own ? null : stand ? (
              <Posture
                key={`${label} ${JSON.stringify(stand.joints)}`}
                {...{ set, robot, label, stand, state, bridge }}
                isOwn={own && (own.again ? words.repeats(own.again) : words.own)}
                back={() => setOwn(null)}
                send={(observation) => {
                  send(observation);
                  setOwn(null);
                }}
                skip={suggested && !own ? () => change.run({ skipped: suggested.label }) : null}
              />
            ) : (
              <section class="card">
                {waiting.length > 0 && !away && <Busy label={words.sending(waiting.length)} />}
                {waiting.length > 0 && away && <p>{words.waitsForNext}</p>}
                {waiting.length === 0 && (
                  <>
                    <p class={reached ? "note good" : "note"}>{words.nothingNext}</p>
                    <div class="go">{closing(true)}</div>
                  </>
                )}
              </section>
            )}
            <Others {...{ set, robot, stand, send, taken }} use={setOwn} />
          </div>
          <div class="sticky">
            <SoFar
              state={state}
              goal={set.open.goal.kind === "joints" ? set.open.goal.relative : null}
              asks={stand !== null && (doubts.length === 0 || own !== null)}
            >
              {phone && closing(false)}
              {keptIn(state).named.map((kept) => (
                <Button acts disabled={change.busy} onClick={() => void again(kept)}>
                  {words.againOf(kept)}
                </Button>
              ))}
            </SoFar>
            <LastReading {...{ set, robot, state }} />
            <Record
              state={state}
              withdraw={(withdrawn, reason) => change.run({ withdrawn: { [withdrawn]: reason } })}
            />
            <TrackerCard bridge={bridge} />
            <Code id={set.id} />
            {phone && simulated}
          </div>
        </div>
      )}
    </>
  );
}

/** The postures of the plan of a set; none without one. */
function usePlanned({ open }: OpenSet): live.Planned[] {
  const id = open?.plan_id; // a closed campaign has no options
  const { data } = useQuery({ ...keptOnDevice(queries.plan(id ?? "")), enabled: id != null });
  return data?.result?.readings ?? [];
}

/** How many postures are fetched ahead: that of the present reading, and two more. */
const AHEAD = 3;

/** Fetch the next postures before they are needed, so that they are drawn without a network, too. */
function useAhead(robot: string, ahead: live.Planned[]): void {
  const next = ahead.slice(0, AHEAD).map(({ joints }) => joints);
  useEffect(() => {
    for (const joints of next)
      void client.prefetchQuery(keptOnDevice(queries.kinematics({ robot_id: robot }, [joints])) as never);
  }, [JSON.stringify(next)]);
}

/** Readings that are not with the service yet, and why. */
function Waits({ set, away, waiting, unstored, taken }: Waited & { set: string; taken: Set<string> }) {
  const resend = (observation: Observation, label: string) => {
    discardReading(set, observation.label);
    sendReadings(set, [{ ...observation, label }]);
  };
  const refused = waiting.filter(({ problem }) => problem !== null);
  return (
    <>
      {away && (
        <p class="note warn" role="status">
          {words.away(waiting.length - refused.length)}
        </p>
      )}
      {unstored && (
        <p class="note warn" role="status">
          {words.unstored}
        </p>
      )}
      {refused.map(({ observation, problem }) => {
        const { label } = observation;
        const other = live.freeLabel(label, taken);
        const conflict = problem?.type.endsWith("label-taken") ?? false;
        return (
          <div class="note bad" role="alert">
            <h3>{conflict ? words.taken(label) : words.refused(label)}</h3>
            {!conflict && problem && <Prose text={[problem.detail, problem.remedy].filter(Boolean).join(" ")} />}
            <div class="row">
              {conflict && <Button onClick={() => resend(observation, other)}>{words.sendAs(other)}</Button>}
              <Button onClick={() => discardReading(set, label)}>{words.discard}</Button>
            </div>
          </div>
        );
      })}
    </>
  );
}

/** The room of the drawing beside that of the arm: its labels are to be read. */
const WITH_LABELS = 1.2;

interface PostureProps {
  set: OpenSet;
  robot: Robot;
  label: string;
  stand: Stand;
  state: LiveState;
  bridge: Bridge;
  /** What to call a posture that was not suggested. */
  isOwn: string | null;
  back: () => void;
  send: (observation: ReturnType<typeof live.observationOf>) => void;
  skip: (() => void) | null;
}

const kindsOf = (robot: Robot): JointKind[] => robot.joints.map(({ kind }) => kind);

/** One posture: the arm, its angles, the load, and the boxes for its readings. */
function Posture({ set, robot, label, stand, state, bridge, isOwn, back, send, skip }: PostureProps) {
  const kinds = kindsOf(robot);
  const unloadedOnly = set.open.load?.kind === "own_weight";
  const targets = (Object.keys(set.open.targets ?? {}).length > 0 ? set.open.targets : set.flange_targets) as Record<
    string,
    Vector
  >;
  const [draft, setDraft] = useState<Draft>(() => drafted(set.id, stand, Object.keys(targets)));
  const latest = useRef(draft);
  const put = (part: Partial<Draft>) => {
    latest.current = { ...latest.current, ...part };
    setDraft(latest.current);
    remember(draftKey(set.id), latest.current);
  };
  const { rows, column } = draft;
  const change = (by: (rows: live.Rows) => live.Rows) => put({ rows: by(latest.current.rows) });
  const byTracker = useRef(new Set<string>());
  const read = useTracked(bridge, { label, joints: stand.joints, force: stand.force }, column, ({ points }) => {
    const before = byTracker.current;
    byTracker.current = new Set(Object.keys(points));
    change((now) => live.tracked(now, column, points, before));
  });
  const readInto = (next: keyof live.Typed) => {
    byTracker.current = new Set();
    put({ column: next });
  };
  const following = read && !unloadedOnly ? followingColumn(column, rows) : null;
  const { kinematics, problem } = useKinematics({ robot_id: robot.id }, [stand.joints], keptOnDevice);
  const posture = kinematics?.[0];
  const room = posture ? roomOf([posture]).flatMap((place) => [place, times(place, WITH_LABELS)]) : [];
  const lacking = live.unread(rows, unloadedOnly);
  const simulate = (mistake: boolean) => {
    if (!posture) return;
    const loadPoint = (set.load_point ?? [0, 0, 0]) as Vector;
    const read = live.simulatedRows(posture, stand.force, { targets, loadPoint });
    change(() => (mistake ? live.exchanged(read) : read));
  };
  const tell = () => {
    send(live.observationOf(label, stand, rows, set.units, kinds, unloadedOnly));
    remember(draftKey(set.id), null);
  };
  const next = !isOwn && state.next;
  const phone = usePhone();
  const why = next && <p class="soft">{next.held_out ? words.heldOut : words.why(next.reason ?? "")}</p>;
  const picture = (
    <>
      {(posture || !problem) && (
        <ArmView
          posture={posture}
          load={posture && norm(stand.force) > 0 ? { from: posture.flange_origin, along: stand.force } : null}
          names={robot.joints.map(({ name }) => name)}
          room={room}
          label={planWords.drawn(label)}
        />
      )}
      {problem && <p class="soft">{problem.title}</p>}
    </>
  );
  const [looks, look] = useState(false);
  return (
    <section class="card live-posture" aria-labelledby="posture">
      <h2 id="posture">
        {words.next(label)} {isOwn && <small class="soft">{isOwn}</small>}
        {phone && <small class="soft"> {words.progress(readIn(state), state.still_needed)}</small>}
      </h2>
      {!phone && picture}
      <p class="angles big">
        {stand.joints.map((angle, i) => (
          <span>
            <small class="soft">{robot.joints[i]?.name}</small> <b>{shownJoint(angle, kinds[i], 1)}</b>
          </span>
        ))}
      </p>
      <p class="load">
        <b>{loadOf(stand)}</b>{" "}
        {set.open.load?.kind === "dead_weight" && (
          <span class="soft">({words.weight(fixed(norm(stand.force) / 9.80665, 1))})</span>
        )}
      </p>
      {!phone && why}
      <ReadingsTable {...{ rows, change, unloadedOnly }} />
      {read && (
        <TrackerSaid
          {...{ rows }}
          reading={read}
          connected={bridge.state?.connected ?? false}
          loaded={column === "loaded"}
        />
      )}
      {Object.entries(read?.unknown ?? {}).map(([name, place]) => (
        <WhichTarget
          {...{ name }}
          numbers={place.map((part) => fixed(1e3 * part, 3)).join(" ")}
          targets={Object.keys(rows)}
          choose={(target) => bridge.rename({ ...bridge.names, [name]: target })}
        />
      ))}
      {set.instrument === live.SIMULATED && (
        <div class="row">
          <Button disabled={!posture} onClick={() => simulate(false)}>
            {words.simulate}
          </Button>
          <Button look="quiet" disabled={!posture} onClick={() => simulate(true)}>
            {words.simulateWrong}
          </Button>
        </div>
      )}
      <div class="go">
        {following ? (
          <Button look="primary big" disabled={!live.isComplete(rows, column)} onClick={() => readInto(following)} acts>
            {words.tracker.keep[column as "unloaded" | "loaded"]}
          </Button>
        ) : (
          <Button look="primary big" disabled={lacking !== null} onClick={tell} acts>
            {words.send}
          </Button>
        )}
        {read && column !== "unloaded" && (
          <Button look="quiet" onClick={() => readInto("unloaded")}>
            {words.tracker.back}
          </Button>
        )}
        {skip && !(read && column !== "unloaded") && (
          <Button look="quiet" onClick={skip} acts>
            {words.skip}
          </Button>
        )}
        {isOwn && (
          <Button look="quiet" onClick={back}>
            {words.suggested}
          </Button>
        )}
      </div>
      {phone && state.joints.length > 0 && (
        <Joints
          state={state}
          goal={set.open.goal.kind === "joints" ? set.open.goal.relative : null}
          read={readIn(state)}
        />
      )}
      {phone && (
        <details onToggle={(event) => look(event.currentTarget.open)}>
          <summary>{words.picture}</summary>
          {looks && picture}
          {why}
        </details>
      )}
    </section>
  );
}

/** What was read in a posture, and the column that a tracker fills. */
interface Draft {
  joints: number[];
  rows: live.Rows;
  column: keyof live.Typed;
}

/** What was read in this posture before the page was left. */
function drafted(id: string, { joints }: Stand, targets: string[]): Draft {
  const draft = recalled(draftKey(id)) as Partial<Draft> | null;
  const rows = Object.fromEntries(targets.map((name) => [name, { unloaded: "", loaded: "" }]));
  const blank: Draft = { joints, rows, column: "unloaded" };
  if (!draft || JSON.stringify(draft.joints) !== JSON.stringify(joints)) return blank;
  return { ...blank, ...draft, rows: { ...rows, ...draft.rows } };
}

/** The column that a tracker fills after another one; null if the reading is complete then. */
function followingColumn(column: keyof live.Typed, rows: live.Rows): keyof live.Typed | null {
  if (column === "unloaded") return "loaded";
  return column === "loaded" && readsAgain(rows) ? "unloaded_after" : null;
}

/** Whether the targets are read again after the load was taken off. */
const readsAgain = (rows: live.Rows): boolean =>
  Object.values(rows).some(({ unloaded_after: after }) => after !== undefined);

interface RowsProps {
  rows: live.Rows;
  change: (by: (rows: live.Rows) => live.Rows) => void;
  unloadedOnly: boolean;
}

/** A block of which something is not in the form. */
interface Left extends Omit<Placed, "rows"> {
  block: Block;
}

function ReadingsTable({ rows, change, unloadedOnly }: RowsProps) {
  const phone = usePhone();
  const [left, setLeft] = useState<Left[]>([]);
  const again = readsAgain(rows);
  const readAgain = () =>
    change((now) =>
      Object.fromEntries(Object.entries(now).map(([target, typed]) => [target, { unloaded_after: "", ...typed }])),
    );
  const columns: (keyof live.Typed)[] = unloadedOnly
    ? ["unloaded"]
    : ["unloaded", "loaded", ...(again ? (["unloaded_after"] as const) : [])];
  const put = (target: string, part: Partial<live.Typed>) =>
    change((now) => {
      const before = now[target];
      return before ? { ...now, [target]: { ...before, ...part } } : now;
    });
  const paste = (target: string, column: keyof live.Typed) => (event: ClipboardEvent) => {
    const pasted = event.clipboardData?.getData("text") ?? "";
    if (!isBlock(pasted)) return;
    event.preventDefault();
    const block = { target, column, text: pasted };
    const { unmatched, faults } = placed(block, rows);
    change((now) => placed(block, now).rows);
    const others = left.filter((one) => one.block.target !== target || one.block.column !== column);
    setLeft(unmatched.length > 0 || faults.length > 0 ? [...others, { block, unmatched, faults }] : others);
  };
  const keep = (one: Left, part: Partial<Left>) => {
    const next = { ...one, ...part };
    const isSettled = next.unmatched.length === 0 && next.faults.length === 0;
    setLeft(left.flatMap((each) => (each !== one ? [each] : isSettled ? [] : [next])));
  };
  const settle = (one: Left, { name, typed }: Unmatched, target: string | null) => {
    if (target !== null) put(target, typed);
    keep(one, { unmatched: one.unmatched.filter((each) => each.name !== name) });
  };
  return (
    <fieldset class="live-readings">
      <legend>
        <b>{phone ? words.readingsShort : words.readings}</b> <small class="soft">{words.readingsHint}</small>{" "}
        <SignButton />
        {!unloadedOnly && !again && (
          <Button look="quiet" aria-label={words.readAgainAfter} onClick={readAgain}>
            {phone ? words.afterShort : words.readAgainAfter}
          </Button>
        )}
      </legend>
      <div class="grid">
        <VectorAxes />
        {Object.entries(rows).map(([target, typed]) => (
          <>
            {columns.map((column) => (
              <>
                <span class="of" aria-hidden="true">
                  <b>
                    <Name>{target}</Name>
                  </b>
                  <small class="soft">{(phone ? words.short : words.columns)[column]}</small>
                </span>
                <VectorBoxes
                  label={words.at(target, words.columns[column])}
                  value={typed[column] ?? ""}
                  change={(value) => put(target, { [column]: value })}
                  paste={paste(target, column)}
                />
              </>
            ))}
            {columns.map((column) => {
              const meant = understood(OF_VECTOR, typed[column] ?? "", text.units.mm);
              return meant && <small class="soft understood">{`${words.columns[column]}: ${meant}`}</small>;
            })}
          </>
        ))}
      </div>
      {left.map((one) => (
        <>
          {one.faults.length > 0 && (
            <div class="note warn" role="alert">
              <p>{words.notPlaced}</p>
              <ul>
                {one.faults.map((fault) => (
                  <li>{fault}</li>
                ))}
              </ul>
              <Button look="quiet" onClick={() => keep(one, { faults: [] })}>
                {words.pasteDiscard}
              </Button>
            </div>
          )}
          {one.unmatched.map((unmatched) => (
            <WhichTarget
              name={unmatched.name}
              numbers={unmatched.typed.unloaded ?? unmatched.typed.loaded ?? ""}
              targets={Object.keys(rows)}
              choose={(target) => settle(one, unmatched, target)}
            />
          ))}
        </>
      ))}
    </fieldset>
  );
}

interface WhichTargetProps {
  /** A name that is no target. */
  name: string;
  /** Its position, as a text [mm]. */
  numbers: string;
  targets: string[];
  /** Hear the target that the name is; null if the name is left out. */
  choose: (target: string | null) => void;
}

/** Ask which target a name is that was pasted, or that a tracker sends. */
const WhichTarget = ({ name, numbers, targets, choose }: WhichTargetProps) => (
  <Select
    label={words.whichTarget(name, numbers)}
    value=""
    change={(target) => target && choose(target === NO_TARGET ? null : target)}
    options={[
      { value: "", label: planWords.pick },
      ...targets.map((target) => ({ value: target, label: target })),
      { value: NO_TARGET, label: words.noTarget },
    ]}
  />
);

/** No name of a target: names are printable. */
const NO_TARGET = "\u0000";

/** The measurement set in a file; text that says what is wrong with the file otherwise. */
async function readingsOf(file: File, { encoders }: OpenSet): Promise<Fields | string> {
  if (file.size > MAX_BYTES) return text.files.faults.too_large.join(" ");
  const campaign = /\.json$/i.test(file.name) ? understand(await file.text()) : "not_json";
  if (typeof campaign !== "string") return campaign.set;
  // Only observations are read: the set has a load point of its own.
  const answer = await api.importFiles([file], { mapping: { encoders, load_point: [0, 0, 0] } });
  const lacking = [...answer.questions.map((question) => question.text), ...answer.faults];
  return (answer.measurement_set as Fields | null) ?? planWords.missing(lacking.join(" "));
}

interface OthersProps {
  set: OpenSet;
  robot: Robot;
  stand: Stand | null;
  use: (stand: Stand) => void;
  send: (...observations: Observation[]) => void;
  taken: Set<string>;
}

/** A posture of one's own, and readings from a file. */
function Others({ set, robot, stand, use, send, taken }: OthersProps) {
  const kinds = kindsOf(robot);
  const [joints, setJoints] = useState("");
  const [force, setForce] = useState("");
  const [fault, setFault] = useState<string | null>(null);
  useEffect(() => {
    if (!stand) return;
    setJoints(stand.joints.map((value, i) => Number(position(value, kinds[i]).toFixed(4))).join(" "));
    setForce(stand.force.map((part) => Number(part.toFixed(2))).join(" "));
  }, [JSON.stringify(stand)]);
  const typed = live.standTyped(joints, force, kinds);
  const planned = usePlanned(set);
  const take = useAction(async (file: File) => {
    setFault(null);
    const read = await readingsOf(await filled(file), set);
    const done = typeof read === "string" ? null : live.readSoFar(read);
    if (!done) return setFault(typeof read === "string" ? read : planWords.nothingRead);
    const { observations, units } = done.document as unknown as Pick<OpenSet, "observations" | "units">;
    const fresh = observations.filter(({ label }) => !taken.has(label));
    send(...fresh.map((one) => inUnits(one, units, set.units, kinds)));
    toast(words.dropped(fresh.length));
  });
  return (
    <section class="card">
      <details>
        <summary>{words.change}</summary>
        {planned.length > 0 && (
          <Select
            label={words.ofThePlan}
            value=""
            change={(label) => {
              const found = planned.find((one) => one.label === label);
              if (found) use(found as unknown as Stand);
            }}
            options={[
              { value: "", label: planWords.pick },
              ...planned.map(({ label, joints: angles }) => ({
                value: label,
                label: `${label}: ${angles.map((value, i) => shownJoint(value, kinds[i], 0)).join("  ")}`,
              })),
            ]}
          />
        )}
        <TextField
          label={`${predictWords.labels.joints} [${text.units.deg}]: ${robot.joints.map(({ name }) => name).join(", ")}`}
          lines={1}
          value={joints}
          change={setJoints}
          help={understood(OF_NUMBERS, joints, text.units.deg)}
        />
        <TextField
          label={words.forceOf}
          unit={text.units.newton}
          lines={1}
          value={force}
          change={setForce}
          help={understood(OF_VECTOR, force, text.units.newton)}
        />
        <Button disabled={!typed} onClick={() => typed && use(typed)}>
          {words.use}
        </Button>
      </details>
      <details>
        <summary>{words.drop}</summary>
        <p class="soft">{words.dropHint}</p>
        <DropZone
          compact
          title={words.drop}
          hint={words.dropHint}
          button={text.files.choose}
          accept=".json,.csv,.tsv,.txt,application/json,text/csv"
          take={take.run}
        />
        {take.busy && <Busy label={text.files.checking} />}
        {fault && <p class="note warn">{fault}</p>}
        {take.problem && <ProblemNote problem={take.problem} />}
      </details>
    </section>
  );
}

/** A plan's list as records of the rows that are filled in: with few rows it does not show what parts its cells. */
async function filled(file: File): Promise<File> {
  const records = /\.(csv|tsv|txt)$/i.test(file.name) ? live.filledRecords(await file.text()) : null;
  return records ? new File([JSON.stringify(records)], `${file.name}.json`) : file;
}

const readIn = ({ readings }: LiveState): number => readings.filter((one) => one.state !== "withdrawn").length;

interface SoFarProps {
  state: LiveState;
  goal: number | null;
  /** Whether a posture is shown, beneath which a phone has the joints. */
  asks: boolean;
  children: ComponentChildren;
}

/** How near the goal is, and the joints so far. */
function SoFar({ state, goal, asks, children }: SoFarProps) {
  const read = readIn(state);
  const phone = usePhone();
  const progress = words.progress(read, state.still_needed);
  const doubtful = state.readings.some((one) => one.state === "doubtful");
  return (
    <section class="card" aria-labelledby="so-far">
      <h2 id="so-far">
        {words.soFar} <small class="soft">{progress}</small>
      </h2>
      <progress value={read} max={Math.max(read + (state.still_needed ?? 0), 1)} aria-label={progress} />
      {!doubtful && (
        <p class={state.state === "reached" ? "note good" : state.state === "cannot" ? "note warn" : ""} role="status">
          <Prose text={sentence(state.message)} />
        </p>
      )}
      {children}
      {!doubtful && (
        <p>
          <b>
            {state.state === "reached"
              ? words.met
              : state.share === null
                ? words.noShare
                : words.ofGoal(percent(state.share))}
          </b>{" "}
          {state.assessment && <Badge verdict={state.assessment.verdict} />}
        </p>
      )}
      {!(phone && asks) && state.joints.length > 0 && <Joints state={state} goal={goal} read={read} />}
      {!doubtful && state.warnings.length > 0 && <Warnings warnings={state.warnings} />}
    </section>
  );
}

/** The residuals of the last reading, drawn when they are unfolded. */
function LastReading(props: { set: OpenSet; robot: Robot; state: LiveState }) {
  const [shown, show] = useState(false);
  const { residuals } = props.state;
  const [first] = residuals;
  if (!first) return null;
  const far = Math.max(...residuals.map(({ residual }) => norm(residual)));
  return (
    <section class="card">
      <details onToggle={(event) => show(event.currentTarget.open)}>
        <summary>
          {words.residuals.title(first.observation)}{" "}
          <small class="soft">{words.residuals.far(`${significant(far * 1e3, 2)} ${text.units.mm}`)}</small>
        </summary>
        {shown && <LastResiduals {...props} />}
      </details>
    </section>
  );
}

/** As many readings determine what the load twists. */
const FEW = 5;

/** Each joint with its interval as a bar, which shrinks; lines where the goal is. */
function Joints({ state, goal, read }: { state: LiveState; goal: number | null; read: number }) {
  const { unit } = useSettings();
  const kinds = state.joints.map(({ kind }) => kind);
  return (
    <>
      <h3>
        {words.stiffness} <small class="soft">{words.half(labelOf(unit, kinds))}</small>
      </h3>
      <ul class="live-joints">
        {state.joints.map(({ name, kind, stiffness, relative, interval, reason }) => {
          const shown = { ...shownWithInterval(stiffness, interval, unit, kind), relative };
          return (
            <li>
              <b>
                <Name>{name}</Name>
              </b>
              <EstimateBar of={shown} goal={goal} />
              <span class="value">
                {stiffness === null || relative === null ? (
                  <span class={reason === null ? "soft" : "soft reason"}>
                    {reason ?? (read < FEW ? words.unknown : words.undetermined)}
                  </span>
                ) : (
                  <Estimate of={shown} brief bare />
                )}
              </span>
            </li>
          );
        })}
      </ul>
    </>
  );
}

function Record({ state, withdraw }: { state: LiveState; withdraw: (label: string, reason: string) => void }) {
  if (state.readings.length === 0) return null;
  const about = ({ distance, ball_ratio: ratio, reason }: LiveState["readings"][number]): string =>
    [
      reason,
      ratio === null ? null : words.asPredicted(ratio <= 1),
      distance === null ? null : words.apart(`${fixed(distance * 1e6, 0)} ${text.units.micrometre}`),
    ]
      .filter(Boolean)
      .join(", ");
  const ask = async (label: string) => {
    const reason = (await askFor(words.why_withdrawn(label), ""))?.trim();
    if (reason) withdraw(label, reason);
  };
  return (
    <section class="card record">
      <details>
        <summary>
          {words.record(state.readings.length, state.readings.filter((one) => one.state === "withdrawn").length)}
        </summary>
        <Rows
          rows={state.readings.map((one) => ({
            id: one.label,
            name: one.label,
            note: words.states[keptIn(state).kept.includes(one.label) ? "kept" : one.state],
            how: about(one),
            actions: one.state !== "withdrawn" && (
              <Button look="quiet" onClick={() => void ask(one.label)} acts>
                {words.withdraw}
              </Button>
            ),
          }))}
        />
      </details>
    </section>
  );
}

/** The address of this page as a QR code. */
function Code({ id }: { id: string }) {
  const page = location.href.replace(/#.*$/, "");
  const address = `${page}${link(["measure", id])}`;
  const [shown, show] = useState(false);
  return (
    <section class="card">
      <details onToggle={(event) => show(event.currentTarget.open)}>
        <summary>{words.qr}</summary>
        {shown && (
          <img class="code" src={api.openSets.code(id, page)} alt={words.qrLabel(address)} width={220} height={220} />
        )}
        <p class="soft">
          <code>{address}</code>
        </p>
        {/^(127\.|localhost$|\[::1\])/.test(location.hostname) && <p class="note warn">{words.qrLocal}</p>}
      </details>
    </section>
  );
}
