/** A planned weight step while it is read: one posture a screen, both angles of each joint from both sides, in both states. */
import type { ComponentChildren } from "preact";
import { useState } from "preact/hooks";
import { api } from "../../api/calls";
import { queries } from "../../api/queries";
import type { Plan, PlanResult, Robot } from "../../api/types";
import {
  ActionButton,
  Button,
  Choice,
  Folded,
  Head,
  LinkButton,
  Name,
  NameLink,
  Seen,
  Show,
} from "../../components/basics";
import { SchemaFields, understood } from "../../components/schema_form";
import { Scroll } from "../../components/table";
import { significant } from "../../lib/format";
import { contentKey, type Fields, unreadIn } from "../../lib/json";
import { numberIn, OF_NUMBER } from "../../lib/schema";
import { ArmView, roomOf } from "../../scene/view";
import { link, useAction } from "../../state/action";
import { isUnstored, recalled, remember } from "../../state/kept";
import { keptOnDevice, useQuery } from "../../state/query";
import { sure } from "../../state/question";
import { text } from "../../words";
import { measureWords } from "../measure/words";
import { shownJoint } from "../plan/view";
import { planWords } from "../plan/words";
import { checkedOf, type Doubt, doubtsOf } from "./doubts";
import * as step from "./step";
import { gearboxWords } from "./words";

const words = gearboxWords.reading;

/** The weight step of a plan. */
export function StepReading({ plan: id }: { plan: string }) {
  const plan = useQuery(keptOnDevice(queries.plan(id)));
  return (
    <Show of={plan} title={words.kind}>
      {(of) =>
        of.result && of.request.weight_step ? (
          <ArmOf plan={of} result={of.result} />
        ) : (
          <>
            <Head plain={words.kind} />
            <p class="note warn">{words.noStep}</p>
            <LinkButton href={link(["plans"], { step: "1" })}>{gearboxWords.planStep}</LinkButton>
          </>
        )
      }
    </Show>
  );
}

function ArmOf(planned: Omit<ReadingProps, "robot">) {
  const robot = useQuery(keptOnDevice(queries.robot(planned.plan.request.robot_id ?? "")));
  return (
    <Show of={robot} title={words.kind}>
      {(of) => <Reading {...planned} robot={of} />}
    </Show>
  );
}

/** What is kept on this device until it is discarded. */
interface Draft {
  /** Name of the robot. */
  robot: string;
  typed: step.Typed;
  state: step.StepState;
  posture: string;
  load: Fields;
}

function useKeptDraft(name: string, start: Draft): [Draft, (part: Partial<Draft>) => void, () => void] {
  const [draft, set] = useState<Draft>(() => ({ ...start, ...(recalled(name) as Partial<Draft> | null) }));
  const put = (part: Partial<Draft>) =>
    set((before) => {
      const next = { ...before, ...part };
      remember(name, next);
      return next;
    });
  const discard = () => {
    set(start);
    remember(name, null);
  };
  return [draft, put, discard];
}

function loadOfPlan({ request, result }: Plan): Fields {
  const { mass, mass_uncertainty, point_uncertainty } = request.weight_step ?? {};
  return { mass, mass_uncertainty: mass_uncertainty ?? null, point: result?.load_point, point_uncertainty };
}

interface ReadingProps {
  plan: Plan;
  result: PlanResult;
  robot: Robot;
}

function Reading({ plan, result, robot }: ReadingProps) {
  const planned = result.readings;
  const kept = `${step.KEPT}${plan.id}`;
  const first = planned[0]?.label ?? "";
  const start: Draft = { robot: robot.name, typed: {}, state: "unloaded", posture: first, load: loadOfPlan(plan) };
  const [draft, put, forget] = useKeptDraft(kept, start);
  const { typed, state, load } = draft;
  const joints = plan.request.joints?.length ? plan.request.joints : result.joints.map(({ name }) => name);
  const kinds = robot.joints.map(({ kind }) => kind);
  const at = Math.max(
    0,
    planned.findIndex(({ label }) => label === draft.posture),
  );
  const observations = step.observationsOf(typed, planned, joints, kinds);
  const discard = async () => {
    if (await sure(words.sureToDiscard)) forget();
  };
  const next = nextOf(
    planned.map(({ label }) => label),
    at,
    state,
  );
  return (
    <>
      <Head
        kind={words.kind}
        plain={robot.name}
        title={<Name>{robot.name}</Name>}
        about={<NameLink to={["plans", plan.id]}>{words.ofPlan}</NameLink>}
      />
      {isUnstored(kept) && <p class="note warn">{words.unstored}</p>}
      <div class="flow">
        <section class="card live-posture" aria-labelledby="posture">
          <Posture {...{ result, robot, at, state, joints, typed }} put={put} />
          <div class="go">
            {next && (
              <Button look="primary big" onClick={() => put(next)}>
                {next.state === state ? measureWords.next(next.posture) : words.nowLoaded}
              </Button>
            )}
          </div>
        </section>
        <div>
          <Overview {...{ planned: planned.map(({ label }) => label), joints, typed, put }} shown={[at, state]} />
          <Doubts {...{ result, robot, joints, typed }} />
          <Identify {...{ robot, load, observations, planned: planned.length }} change={(of) => put({ load: of })}>
            <Button look="quiet" disabled={Object.keys(typed).length === 0} onClick={() => void discard()}>
              {words.discard}
            </Button>
          </Identify>
        </div>
      </div>
    </>
  );
}

/** What is read next: all postures without the load, then all postures with it; null at the end. */
function nextOf(labels: string[], at: number, state: step.StepState): Pick<Draft, "posture" | "state"> | null {
  const following = labels[at + 1];
  if (following !== undefined) return { posture: following, state };
  const first = labels[0];
  return state === "unloaded" && first !== undefined ? { posture: first, state: "loaded" } : null;
}

interface PostureProps {
  result: PlanResult;
  robot: Robot;
  at: number;
  state: step.StepState;
  joints: string[];
  typed: step.Typed;
  put: (part: Partial<Draft>) => void;
}

/** The posture that is read: the arm, its angles, and boxes for both angles of each joint from both sides. */
function Posture({ result, robot, at, state, joints, typed, put }: PostureProps) {
  const shown = result.readings[at];
  const all = result.readings.map((each) => each.joints);
  const { data: drawn } = useQuery(keptOnDevice(queries.kinematics({ robot_id: robot.id }, all)));
  if (!shown) return null;
  const posture = drawn?.[at];
  const places = step.placesOf(shown.label, joints, state);
  const missing = step.missingOf(typed, places);
  const isLoaded = state === "loaded";
  return (
    <>
      <h2 id="posture">{planWords.posture(shown.label)}</h2>
      <Choice
        label={words.state}
        value={state}
        change={(to: step.StepState) => put({ state: to })}
        options={words.states}
      />
      {isLoaded && <p class="note">{words.hang}</p>}
      <Folded label={words.picture}>
        <ArmView
          posture={posture}
          load={posture && isLoaded ? { from: posture.flange_origin, along: shown.force } : null}
          names={robot.joints.map(({ name }) => name)}
          room={roomOf(drawn ?? [])}
          label={planWords.drawn(shown.label)}
        />
      </Folded>
      <p class="angles big">
        {shown.joints.map((value, i) => (
          <span>
            <small class="soft">
              <Name>{robot.joints[i]?.name ?? ""}</Name>
            </small>{" "}
            <b>{shownJoint(value, robot.joints[i]?.kind, 1)}</b>
          </span>
        ))}
      </p>
      <p class="soft">{words.sides}</p>
      <Scroll label={words.angles}>
        <table class="inputs knowledge">
          <thead>
            <tr>
              <th scope="col">{words.from}</th>
              {step.ENCODERS.map((encoder) => (
                <th scope="col">{words.encoders[encoder]}</th>
              ))}
            </tr>
          </thead>
          <tbody>
            {places.map((place) => (
              <tr key={step.keyOf(place, "motor")}>
                <th scope="row">
                  <Name>{place.joint}</Name> {words.side[place.side]}
                </th>
                {step.ENCODERS.map((encoder) => {
                  const key = step.keyOf(place, encoder);
                  const value = typed[key] ?? "";
                  return (
                    <td>
                      <input
                        type="text"
                        inputMode="decimal"
                        autocomplete="off"
                        aria-label={labelOf(place, encoder)}
                        aria-invalid={Number.isNaN(numberIn(value))}
                        value={value}
                        onInput={(event) => put({ typed: { ...typed, [key]: event.currentTarget.value } })}
                      />
                    </td>
                  );
                })}
              </tr>
            ))}
          </tbody>
        </table>
      </Scroll>
      {places.flatMap((place) =>
        step.ENCODERS.map((encoder) => {
          const meant = understood(OF_NUMBER, typed[step.keyOf(place, encoder)] ?? "", text.units.deg);
          return meant && <small class="soft">{`${labelOf(place, encoder)}: ${meant} `}</small>;
        }),
      )}
      <p class="soft" role="status">
        {missing.length === 0
          ? words.complete
          : words.missing(missing.map(({ joint, side }) => `${joint} ${words.side[side]}`))}
      </p>
    </>
  );
}

const labelOf = ({ joint, side }: step.Place, encoder: step.Encoder): string =>
  words.box(joint, words.side[side], words.encoders[encoder]);

interface OverviewProps {
  planned: string[];
  joints: string[];
  typed: step.Typed;
  shown: [number, step.StepState];
  put: (part: Partial<Draft>) => void;
}

/** All postures in both states: what is read, and what is missing. */
function Overview({ planned, joints, typed, shown: [at, state], put }: OverviewProps) {
  return (
    <section class="card" aria-labelledby="postures">
      <h2 id="postures">{planWords.postures}</h2>
      <Scroll label={planWords.postures}>
        <table class="postures wraps">
          <thead>
            <tr>
              <th scope="col">{planWords.reading}</th>
              {step.STATES.map((each) => (
                <th scope="col">{words.states[each]}</th>
              ))}
            </tr>
          </thead>
          <tbody>
            {planned.map((posture, i) => (
              <tr class={i === at ? "shown" : undefined}>
                <th scope="row">{posture}</th>
                {step.STATES.map((each) => {
                  const places = step.placesOf(posture, joints, each);
                  const missing = step.missingOf(typed, places).length;
                  const standing = words.read(places.length - missing, places.length);
                  return (
                    <td>
                      <Button
                        look="quiet"
                        aria-label={words.goTo(posture, words.states[each], standing)}
                        aria-pressed={i === at && each === state}
                        onClick={() => put({ posture, state: each })}
                      >
                        {standing}
                      </Button>
                    </td>
                  );
                })}
              </tr>
            ))}
          </tbody>
        </table>
      </Scroll>
    </section>
  );
}

/** What is doubtful in the readings so far, and what to do. */
function Doubts({ result, robot, joints, typed }: Pick<PostureProps, "result" | "robot" | "joints" | "typed">) {
  const all = result.readings.map((each) => each.joints);
  const { data: drawn } = useQuery(keptOnDevice(queries.kinematics({ robot_id: robot.id }, all)));
  if (Object.keys(typed).length === 0) return null;
  const point = result.load_point ?? [0, 0, 0];
  const postures = result.readings.map((planned, i) => checkedOf(planned, drawn?.[i], point));
  const names = robot.joints.map(({ name }) => name);
  const doubts = doubtsOf(typed, postures, names, joints);
  return (
    <section class="card" aria-labelledby="doubts" aria-live="polite">
      <h2 id="doubts">{words.doubts}</h2>
      {doubts.length === 0 && <p class="soft">{words.noDoubts}</p>}
      <ul class="warnings">
        {doubts.map((doubt) => (
          <li class="note warn">
            <Seen warning={{ where: doubt.joint, message: messageOf(doubt) }} />
            <p class="remedy">{words.remedyOf[doubt.kind]}</p>
          </li>
        ))}
      </ul>
    </section>
  );
}

const messageOf = ({ kind, size, postures }: Doubt): string =>
  words.doubt[kind](significant(size, 2), postures.join(", "));

interface IdentifyProps {
  robot: Robot;
  load: Fields;
  change: (load: Fields) => void;
  observations: ReturnType<typeof step.observationsOf>;
  planned: number;
  children: ComponentChildren;
}

/** The load, and the button, as soon as the readings determine a result. */
function Identify({ robot, load, change, observations, planned, children }: IdentifyProps) {
  const start = useAction(async () => {
    const request = step.requestOf(robot.name, robot.id, load, observations);
    const made = await api.gearboxes.add(request, contentKey("gearbox", request));
    return link(["gearboxes", made.id]);
  }, "gearbox");
  const isEnough = step.mostRead(observations) >= step.LEAST_POSTURES;
  const isStated = Boolean(load["mass"] && load["point"]) && unreadIn(load) === null;
  const lacking = isEnough ? (isStated ? null : words.noLoad) : words.tooFew(step.LEAST_POSTURES);
  return (
    <section class="card form" aria-labelledby="load">
      <h2 id="load">{gearboxWords.load}</h2>
      <SchemaFields
        of="HungLoad"
        show={["mass", "mass_uncertainty", "point", "point_uncertainty"]}
        value={load}
        change={change}
        terms={{ labels: gearboxWords.ofLoad, units: UNITS_OF_LOAD }}
      />
      <p class="soft">{words.bothStates(observations.length, planned)}</p>
      <ActionButton look="primary big" action={start} lacking={lacking} going={text.start.going}>
        {gearboxWords.identify}
      </ActionButton>
      {children}
    </section>
  );
}

const MM = [text.units.mm, 1e-3] as const;
const UNITS_OF_LOAD = { point: MM, point_uncertainty: MM };
