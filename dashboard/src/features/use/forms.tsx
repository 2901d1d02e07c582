/** What a result is used for: deflections that are predicted, maps of a work area, programs that are corrected, files; each asked for in a tab of its run. */
import { useMemo, useState } from "preact/hooks";
import { api } from "../../api/calls";
import type { DeflectionResult, Posture, Problem, Run, RunResult } from "../../api/types";
import {
  ActionButton,
  Busy,
  Button,
  Download,
  Facts,
  LinkButton,
  ProblemNote,
  Prose,
  Toggle,
} from "../../components/basics";
import { Select, RequestFields } from "../../components/fields";
import { SchemaFields, DropZone, type Terms, useDescribed } from "../../components/schema_form";
import { bendOf, bent, loadOf, type Vector, add, fromFlange, norm, times } from "../../lib/vector";
import type { Pull } from "../../lib/pull";
import { Estimate } from "../../components/estimate";
import { shownEstimate } from "../../lib/estimate";
import { percent, roundStep } from "../../lib/format";
import { type Fields, unreadIn, freshKey, stated } from "../../lib/json";
import { sentence } from "../../lib/said";
import { factors, position, positionIn, positionUnit } from "../../lib/stiffness";
import { BoxView } from "../../scene/box_view";
import { ArmView, roomOf } from "../../scene/view";
import { useAction, useLatest, asking, link } from "../../state/action";
import { text } from "../../words";
import { firstStand, type PartProps, type RunContext, usePostures } from "../../state/run_context";
import { VerdictCard } from "../../components/job_page";
import { boxAround } from "../../lib/map";
import { useKinematics } from "../../state/kinematics";
import { recalled, remember } from "../../state/kept";
import { sure } from "../../state/question";
import { useDraft, useTypedValue } from "../../state/session";
import { sceneWords } from "../../scene/words";
import { formWords, sourceWords } from "../../components/words";
import { fileWords, correctWords, mapWords, predictWords } from "./words";

const words = predictWords;

/** What must be done first: what is not understood is written again, then what is missing is given, in order. */
export function lackOf(asked: Fields, needed: Partial<Record<keyof typeof formWords.lacking, unknown>>): string | null {
  const typed = unreadIn(asked);
  if (typed !== null) return formWords.unread(typed);
  const missing = Object.entries(needed).find(([, value]) => !value)?.[0];
  return missing === undefined ? null : formWords.lacking[missing as keyof typeof formWords.lacking];
}

export function PredictPart(props: PartProps) {
  const postures = usePostures(props.context.set, props.context.robot);
  const isDescribed = useDescribed();
  return postures && isDescribed ? <Form {...props} postures={postures} /> : <Busy />;
}

/** A prediction with the posture and the load that it is about, R0, SI. */
interface Predicted {
  posture: Posture;
  point: Vector;
  force: Vector;
  answer: DeflectionResult;
  /** Posture and place that were asked about, as text: an answer is shown only with its own question. */
  place: string;
  /** Of the picture: how long a newton is drawn [m/N], and by how much deflections are exaggerated. */
  scale: number;
  factor: number;
}

const rounded = (values: readonly number[], digits: number): number[] =>
  values.map((value) => Number(value.toFixed(digits)));

/** A case in degrees, mm and N. */
interface Case extends Fields {
  joints: number[];
  force: Vector;
  load_point: Vector;
}

function Form({ context: { run, set, robot }, result, postures }: PartProps & { postures: Posture[] }) {
  const unit = factors(set.units);
  const kinds = robot.joints.map(({ kind }) => kind);
  const point = (set.load_point ?? set.observations[0]?.load_point ?? [0, 0, 0]) as Vector;
  const measured = (i: number): Partial<Case> => {
    const [observation, posture] = [set.observations[i], postures[i]];
    if (!observation || !posture) return {};
    const shown = (value: number, j: number) =>
      position(value * (kinds[j] === "prismatic" ? unit.length : unit.angle), kinds[j]);
    const force = rounded(loadOf(set, observation, posture).force, 1) as unknown as Vector;
    return { joints: rounded(observation.joints.map(shown), 3), force };
  };
  const [chosen, setChosen] = useTypedValue(`predict/${run.id}/posture`, "0");
  const [asked, setAsked] = useTypedValue<Fields>(`predict/${run.id}`, {
    load_point: rounded(times(point, 1e3 * unit.length), 3),
    ...measured(0),
  });
  const [found, setFound] = useState<Predicted | null>(null);
  /** The force to which a hand pulled: the last answer stays until its own is there. */
  const [pulled, setPulled] = useState<Vector | null>(null);
  const answerTo = (cases: Fields) =>
    api.predict({ run_id: run.id, units: { length: "mm", angle: "deg", force: "N" }, cases: [cases] });
  const predict = useAction(async () => {
    const { joints, force, load_point: place } = asked as Case;
    const answer = await answerTo(asked);
    const angles = joints.map((shown, j) => positionIn(shown, kinds[j]));
    const [posture] = await api.kinematics({ robot_id: robot.id }, [angles]);
    if (!posture) return;
    const inBase = fromFlange(posture.flange_origin, posture.flange_axes, times(place, 1e-3));
    setPulled(null);
    setFound({ posture, point: inBase, force, answer, place: placeOf(asked), ...picturedBy(posture, force, answer) });
  });
  const follow = useLatest(async (question: Case) => {
    const answer = await answerTo(question);
    setFound((before) => withPulled(before, question, answer));
  });
  const pull = (force: Vector) => {
    setPulled(force);
    const question = { ...(asked as Case), force };
    setAsked(question);
    follow.run(question);
  };
  const isSame = (force: Vector | null | undefined) => JSON.stringify(force) === JSON.stringify(asked["force"]);
  const isShown = found?.place === placeOf(asked) && (isSame(found.force) || isSame(pulled));
  const ofJoints = kinds.includes("prismatic") ? kinds.map((kind) => positionUnit(kind).trim()).join(", ") : deg;
  return (
    <div class="flow">
      <section class="card form">
        <h2>{words.title}</h2>
        <Select
          label={words.posture}
          value={chosen}
          change={(value) => {
            setChosen(value);
            setAsked({ ...asked, ...measured(Number(value)) });
          }}
          options={set.observations.map(({ label }, i) => ({ value: String(i), label }))}
        />
        <SchemaFields
          of="LoadCase"
          show={["joints", "force", "load_point"]}
          value={asked}
          change={setAsked}
          terms={{ labels: words.labels, units: { joints: [ofJoints, 1], force: [newton, 1], load_point: [mm, 1] } }}
        />
        <ActionButton
          look="primary"
          action={predict}
          lacking={lackOf(asked, {
            joints: asked["joints"],
            force_there: asked["force"],
            load_point: asked["load_point"],
          })}
        >
          {text.run.views.predict}
        </ActionButton>
      </section>
      {found && isShown ? (
        <section class="card" aria-live="polite" aria-busy={!isSame(found.force)}>
          <Bent found={found} result={result} pulled={pulled} pull={pull} />
          {follow.problem && <ProblemNote problem={follow.problem} />}
          <Answer answer={found.answer} run={run} />
        </section>
      ) : (
        <section class="card">
          <Standing
            robot={robot.id}
            joints={numbersIn(asked["joints"], kinds.length)?.map((shown, j) => positionIn(shown, kinds[j])) ?? null}
            force={asked["force"]}
            place={asked["load_point"]}
          />
        </section>
      )}
    </div>
  );
}

/** So many numbers of a field; null while one is missing or is not understood. */
const numbersIn = (value: unknown, count: number): readonly number[] | null =>
  Array.isArray(value) && value.length === count && value.every(Number.isFinite) ? value : null;

interface StandingProps {
  robot: string;
  /** Where the arm stands [rad, m]; null keeps the last picture. */
  joints: number[] | null;
  /** Force as a form has it, along R0 [N]. */
  force?: unknown;
  /** Where it acts, in the frame of the flange [mm]. */
  place?: unknown;
}

/** The arm as a form has it so far, with the force that was typed. */
function Standing({ robot, joints, force, place }: StandingProps) {
  const posture = useKinematics(joints && { robot_id: robot }, joints ? [joints] : []).kinematics?.[0];
  const along = numbersIn(force, 3) as Vector | null;
  const pulls = along !== null && norm(along) > 0;
  const inFlange = times((numbersIn(place, 3) as Vector | null) ?? [0, 0, 0], 1e-3);
  const from = posture && fromFlange(posture.flange_origin, posture.flange_axes, inFlange);
  const tip = from && pulls ? [add(from, times(along, (0.3 * reachOf(posture)) / norm(along)))] : [];
  return (
    <ArmView
      posture={posture}
      axes={false}
      load={from && pulls ? { from, along } : null}
      room={[...(posture ? roomOf([posture]) : []), ...tip]}
      label={words.view}
    />
  );
}

/** What is shown, with the answer to a pull: a late answer about another posture or place changes nothing. */
export const withPulled = (found: Predicted | null, question: Case, answer: DeflectionResult): Predicted | null =>
  found?.place === placeOf(question) ? { ...found, force: question.force, answer } : found;

/** Posture and place of a case as text, without its force. */
const placeOf = ({ force: _, ...place }: Fields): string => JSON.stringify(place);

/** How a force and its deflection are drawn, also while the force is pulled. */
function picturedBy(posture: Posture, force: Vector, answer: DeflectionResult): Pick<Predicted, "scale" | "factor"> {
  const reach = reachOf(posture);
  const displacement = (answer.cases[0]?.displacement ?? [0, 0, 0]) as Vector;
  return {
    scale: (0.3 * reach) / (norm(force) || 1000),
    factor: roundStep((0.14 * reach) / Math.max(1e-9, norm(displacement)), 1),
  };
}

const reachOf = (posture: Posture): number => Math.max(0.2, ...roomOf([posture]).map(norm));

interface BentProps {
  found: Predicted;
  result: RunResult;
  pulled: Vector | null;
  pull: (force: Vector) => void;
}

/** The arm and its deflection under a force that a hand pulls; pulled, the arm stays bent. */
function Bent({ found: { posture, point, force, answer, scale, factor }, result, pulled, pull }: BentProps) {
  const displacement = (answer.cases[0]?.displacement ?? [0, 0, 0]) as Vector;
  const compliances = result.joints.map((joint) => joint.compliance);
  const bend = bendOf(posture, compliances, { point, force });
  const side = 0.4 * reachOf(posture);
  const about = [-side, side].flatMap((by) => [add(point, [by, by, by]), add(point, [by, -by, by])]);
  const [bends, setBends] = useState(0);
  const arrow: Pull = { from: point, force: pulled ?? force, scale };
  return (
    <>
      <ArmView
        posture={
          pulled
            ? bent(
                posture,
                bend.map((angle) => angle * factor),
              )
            : posture
        }
        axes={false}
        predicted={[{ from: point, along: displacement }]}
        pull={arrow}
        pulled={pull}
        factor={factor}
        bend={pulled ? [] : bend}
        room={[...roomOf([posture]), ...about]}
        label={words.view}
        bends={bends}
      />
      <p class="soft">{words.pull}</p>
      {!pulled && <Button onClick={() => setBends((count) => count + 1)}>{sceneWords.bend}</Button>}
    </>
  );
}

export function Answer({ answer, run }: { answer: DeflectionResult; run?: Run }) {
  const { assessment, cases, confidence, remarks } = answer;
  const [found] = cases;
  if (!found) return null;
  const { micrometre } = text.units;
  const { displacement, readings_only: readings, with_model_error: model, budget } = found;
  const unusable = assessment.verdict === "do_not_use";
  const micro = (value: number, ends: readonly [number, number] | null) => (
    <Estimate of={shownEstimate(1e6 * value, ends && [1e6 * ends[0], 1e6 * ends[1]], unusable)} unit={micrometre} />
  );
  const size = norm(displacement ?? [0, 0, 0]);
  const whole = budget?.[model ? "expanded_with_model_error" : "expanded_uncertainty"] ?? model?.radius ?? null;
  return (
    <>
      {(assessment.headline ?? assessment.verdict !== "use") && (
        <VerdictCard assessment={assessment} context={null} of={run} />
      )}
      {displacement && (
        <Facts
          facts={[
            {
              label: mapWords.quantities.deflection,
              value: micro(size, whole === null ? null : [Math.max(0, size - whole), size + whole]),
            },
            ...displacement.map((value, i) => ({
              label: words.along("xyz"[i] ?? ""),
              value: micro(value, (model?.displacement ?? readings)?.[i] ?? null),
            })),
            {
              label: sourceWords.inBrackets,
              value: <span class="brackets">{sourceWords.source(percent(confidence), model !== null)}</span>,
            },
          ]}
        />
      )}
      {[...found.remarks, ...remarks].map((remark) => (
        <p class="note warn">
          <Prose text={sentence(remark)} />
        </p>
      ))}
    </>
  );
}

export function MapForm({ context }: { context: RunContext }) {
  const postures = usePostures(context.set, context.robot);
  return postures ? <AskMap context={context} postures={postures} /> : <Busy />;
}

function AskMap({ context: { run, set, robot }, postures }: { context: RunContext; postures: Posture[] }) {
  const start = useMemo(() => proposal(set, postures), [set, postures]);
  const [asked, change] = useDraft<Fields>(`map/${run.id}`, start);
  const [near, setNear] = useTypedValue(`map/${run.id}/near`, "");
  const make = useAction(async () => {
    const { angle } = factors(set.units);
    const joints = near && set.observations[Number(near)]?.joints.map((value) => value * angle);
    const map = { run_id: run.id, ...asked, ...(joints ? { near: joints } : {}) };
    const made = await asking((accepted) => api.maps.add({ ...map, ...accepted }, freshKey("map")));
    remember(LAST_FORCE, asked["force"]);
    return link(["maps", made.id]);
  });
  return (
    <RequestFields action={make} look="card form" known={useDescribed()}>
      <h2>{mapWords.form}</h2>
      <p>{mapWords.formNote}</p>
      <BoxView
        robot={set.robot_id}
        joints={firstStand({ set, robot })}
        value={asked["area"]}
        unit={1}
        change={(area) => change({ area })}
      >
        <SchemaFields
          of="MapRequest"
          show={["area", "grid", "force", "place", "tool_axis", "directions", "turns"]}
          value={asked}
          change={change}
          terms={{ labels: mapWords.labels }}
        />
      </BoxView>
      <LastForce force={asked["force"]} use={(force) => change({ force })} />
      <Select
        label={mapWords.posture}
        value={near}
        change={setNear}
        options={[
          { value: "", label: mapWords.stiffest },
          ...set.observations.map(({ label }, i) => ({ value: String(i), label: mapWords.nearestTo(label) })),
        ]}
      />
      <ActionButton look="primary" action={make} lacking={lackOf(asked, { force: asked["force"] })}>
        {mapWords.make}
      </ActionButton>
    </RequestFields>
  );
}

/** The box of the load points, and the mean way the flange looked. */
function proposal(set: RunContext["set"], postures: Posture[]): Fields {
  const loads = postures.flatMap((posture, i) => {
    const observation = set.observations[i];
    return observation ? [loadOf(set, observation, posture)] : [];
  });
  const sum = postures.reduce<Vector>((all, { flange_axes: axes }) => add(all, axes[2] ?? [0, 0, 0]), [0, 0, 0]);
  const mean: Vector = norm(sum) > 0.2 * postures.length ? times(sum, 1 / norm(sum)) : [0, 0, -1];
  const point = times(set.load_point ?? set.observations[0]?.load_point ?? [0, 0, 0], factors(set.units).length);
  return {
    area: boxAround(loads.map((load) => load.point)),
    grid: [15, 15, 5],
    place: rounded(point, 4),
    tool_axis: [0, 0, 1],
    directions: [rounded(mean, 2)],
    turns: 8,
  };
}

const LAST_FORCE = "force.last";

/** The process force that was used last on this device, for an empty field: nobody typed it here. */
function LastForce({ force, use }: { force: unknown; use: (force: number[]) => void }) {
  const last = recalled(LAST_FORCE) as number[] | null;
  if (force || !last) return null;
  return (
    <Button look="quiet" onClick={() => use(last)}>
      {formWords.lastForce(last.join(", "))}
    </Button>
  );
}

const NOT_UNDERSTOOD = "urn:jointstiff:problem:invalid-file";
const { deg, mm, newton } = text.units;
const OF_PROGRAM: Terms = {
  labels: correctWords.labels,
  units: { start: [`${deg}, ${mm}`, 1], force: [newton, 1] },
  choices: { accuracy_option: correctWords.accuracies, axes: correctWords.axesOf },
};

/** Whether moves were left because of what external axes may carry. */
const asksForAxes = (problem: Problem | null): boolean =>
  (problem?.errors ?? []).some(({ remedy }) => remedy?.includes("external_axes"));

/** Names of the routines of other files because of which moves were left; each is quoted in its remedy. */
const unknownRoutines = (problem: Problem | null): string[] => [
  ...new Set(
    (problem?.errors ?? []).flatMap(({ remedy }) =>
      remedy?.includes("trust_routines") ? [...remedy.matchAll(/'([^']+)'/g)].map(([, name]) => name ?? "") : [],
    ),
  ),
];

interface Files {
  files: File[];
  take: (file: File) => void;
  remove: (file: File) => void;
}

/** Files that are dropped one by one: one of the same name takes the place of the one before. */
function useFiles(changed?: () => void): Files {
  const [files, setFiles] = useState<File[]>([]);
  return {
    files,
    take: (file) => {
      setFiles((before) => [...before.filter((one) => one.name !== file.name), file]);
      changed?.();
    },
    remove: (file) => setFiles((before) => before.filter((one) => one !== file)),
  };
}

/** Where files of a program are dropped, and those that were. */
const ProgramFiles = ({ of, title, hint }: { of: Files; title: string; hint: string }) => (
  <>
    <DropZone title={title} hint={hint} button={correctWords.choose} accept={correctWords.accept} take={of.take} />
    {of.files.length > 0 && (
      <ul>
        {of.files.map((file) => (
          <li>
            <bdi>{file.name}</bdi>{" "}
            <Button look="quiet" onClick={() => of.remove(file)}>
              {correctWords.remove}
            </Button>
          </li>
        ))}
      </ul>
    )}
  </>
);

interface FrameFieldProps {
  of: Fields;
  name: "tools" | "bases";
  change: (fields: Fields) => void;
}

/** The tool or base of a program that only names this frame. */
const FrameField = ({ of, name, change }: FrameFieldProps) => (
  <SchemaFields
    of="ProgramFrame"
    show={["values"]}
    value={(of[name] as Fields[] | undefined)?.[0] ?? {}}
    change={({ values }) => change({ [name]: values ? [{ values }] : [] })}
    terms={{ labels: { values: correctWords[name] }, within: `${name}[0].` }}
  />
);

/** What a program is corrected for: its files, tool, base, process force, and the controller's accuracy option. */
export function CorrectForm({ context }: { context: RunContext }) {
  const { run } = context;
  const [asked, change] = useDraft<Fields>(`corrections/${run.id}`, {});
  const [leave, setLeave] = useState(false);
  const [trust, setTrust] = useState<string[]>([]); // routines that the user trusts, as the question named them
  const sent = useFiles(() => {
    setLeave(false); // confirmed for the lines of another program
    setTrust([]);
  });
  const { files } = sent;
  const force = asked["force"];
  const make = useAction(async () => {
    const units = { length: "mm", angle: "deg", force: "N" };
    const answers = { ...(leave ? { leave_others: true } : {}), ...(trust.length ? { trust_routines: true } : {}) };
    const format = files[0]?.name.toLowerCase().endsWith(".csv") ? { format: "csv" } : {}; // targets, no table of poses
    const body = { run_id: run.id, units, ...(stated(asked) as Fields), ...answers, ...format };
    const made = await asking((accepted) => api.corrections.add(files, { ...body, ...accepted }, freshKey("correct")));
    remember(LAST_FORCE, force);
    return link(["corrections", made.id]);
  });
  const routines = trust.length ? trust : unknownRoutines(make.problem);
  const known = useDescribed();
  return (
    <div class="flow">
      <RequestFields action={make} look="card form" known={known}>
        <h2>{correctWords.form}</h2>
        <p>{correctWords.formNote}</p>
        <ProgramFiles of={sent} title={correctWords.drop} hint={correctWords.dropHint} />
        <SchemaFields
          of="CorrectionRequest"
          show={["accuracy_option", "axes", "start", "force"]}
          value={asked}
          change={change}
          terms={OF_PROGRAM}
        />
        <div class="fields">
          <FrameField of={asked} name="tools" change={change} />
          <FrameField of={asked} name="bases" change={change} />
        </div>
        <LastForce force={force} use={(last) => change({ force: last })} />
        {(asked["external_axes"] || asksForAxes(make.problem)) && (
          <Toggle
            label={correctWords.carryNothing}
            checked={asked["external_axes"] === "carry_nothing"}
            change={(on) => change({ external_axes: on ? "carry_nothing" : null })}
          />
        )}
        {routines.length > 0 && (
          <Toggle
            label={correctWords.trust(routines)}
            checked={trust.length > 0}
            change={(on) => setTrust(on ? routines : [])}
          />
        )}
        {(leave || make.problem?.type === NOT_UNDERSTOOD) && (
          <Toggle label={correctWords.leave} checked={leave} change={setLeave} />
        )}
        <ActionButton
          look="primary"
          action={make}
          lacking={lackOf(asked, { program: files.length > 0, accuracy_option: asked["accuracy_option"], force })}
        >
          {correctWords.make}
        </ActionButton>
      </RequestFields>
      <section class="card sticky">
        <Standing
          robot={context.robot.id}
          joints={firstStand(context)}
          force={(asked["axes"] ?? "robot") === "robot" ? force : null}
        />
      </section>
    </div>
  );
}

export function RunFiles({ context, result: { assessment } }: PartProps) {
  const run = context.run.id;
  const refused = assessment.verdict === "do_not_use";
  /** The file of a result that is not to be used is asked about first. */
  const asked = async (event: Event & { currentTarget: HTMLAnchorElement }) => {
    if (!refused) return;
    event.preventDefault();
    const { href } = event.currentTarget;
    if (await sure(text.assessment.sure(assessment.reasons.map(({ message }) => message)))) location.assign(href);
  };
  return (
    <section class="card">
      <h2>{fileWords.title}</h2>
      <p class="soft">{fileWords.intro}</p>
      <div class="actions">
        <Download href={api.jobs.file(run, "report.pdf")}>{text.run.pdf}</Download>
        <LinkButton href={api.jobs.file(run, "report.html")} target="_blank" rel="noreferrer">
          {fileWords.html}
        </LinkButton>
        {(Object.keys(fileWords.models) as (keyof typeof fileWords.models)[]).map((format) => (
          <LinkButton
            key={format}
            href={api.jobs.file(run, `model.${format}${refused ? "?accept_verdict=do_not_use" : ""}`)}
            onClick={(event) => void asked(event)}
            title={fileWords.models[format][1]}
            download
          >
            {fileWords.models[format][0]}
          </LinkButton>
        ))}
      </div>
    </section>
  );
}
