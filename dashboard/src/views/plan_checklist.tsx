/** A plan carried out on the tablet: postures ticked off and drawn, readings taken as they grow, how sure the joints are. */
import { useMemo, useState } from "preact/hooks";
import { api } from "../api/client";
import type { ImportOptions, JointKind, Plan, PlanResult, Posture, Robot, Run } from "../api/types";
import { Badge } from "../components/badge";
import { Busy, Button, ProblemNote } from "../components/basics";
import { DropZone } from "../components/drop";
import { DataTable } from "../components/table";
import { understand } from "../lib/campaign";
import { type Planned, readSoFar, surenessOf } from "../lib/checklist";
import { fixed, percent } from "../lib/format";
import { contentKey } from "../lib/hash";
import { position, positionUnit } from "../lib/units";
import { type Vector, norm } from "../lib/vector";
import { ARM_ALONE } from "../scene/show";
import { ArmView, roomOf } from "../scene/view";
import { useAction } from "../state/action";
import { useCached } from "../state/cache";
import { valueOf } from "../state/load";
import { link } from "../state/router";
import { text } from "../i18n";
import { alongText } from "./next_measurement";

const words = text.plan;
const MAX_BYTES = 8 * 1024 * 1024;

export function Checklist({ plan, result, robot }: { plan: Plan; result: PlanResult; robot: Robot }) {
  const [ticks, tick] = useTicks(plan.id);
  const [chosen, choose] = useState<string | null>(null);
  const readings = result.readings;
  const next = readings.find(({ label }) => !ticks.has(label)) ?? null;
  const shown = readings.find(({ label }) => label === chosen) ?? next ?? readings[0];
  const drawn = valueOf(
    useCached(
      `plan/${plan.id}`,
      async () =>
        (
          await api.kinematics(
            { robot_id: robot.id },
            readings.map(({ joints }) => joints),
          )
        ).postures,
      Number.POSITIVE_INFINITY,
    ),
  );
  const done = readings.filter(({ label }) => ticks.has(label)).length;
  return (
    <div class="flow">
      <section class="card" aria-labelledby="checklist">
        <h2 id="checklist">
          {words.checklist} <small class="soft">{words.checked(done, readings.length)}</small>
        </h2>
        {plan.request.measurement_set_id && <p class="soft">{words.newAlone}</p>}
        <progress value={done} max={readings.length} aria-label={words.checked(done, readings.length)} />
        <ol class="checklist">
          {readings.map((each) => (
            <li class={each === shown ? "shown" : undefined}>
              <label class="toggle">
                <input
                  type="checkbox"
                  checked={ticks.has(each.label)}
                  aria-label={words.tick(each.label)}
                  onChange={(event) => {
                    tick([each.label], event.currentTarget.checked);
                    choose(null); // the next one is drawn
                  }}
                />
                <b>{each.label}</b>
              </label>
              <Button look="quiet" onClick={() => choose(each.label)}>
                <span class="hidden">{words.show(each.label)}: </span>
                {angles(each, robot)}
              </Button>
            </li>
          ))}
        </ol>
      </section>
      <div class="sticky">
        {shown && <Current reading={shown} robot={robot} postures={drawn} index={readings.indexOf(shown)} />}
        <Readings result={result} robot={robot} done={(labels) => tick(labels, true)} />
      </div>
    </div>
  );
}

export const shownJoint = (value: number, kind: JointKind | undefined, decimals: number): string =>
  `${fixed(position(value, kind), decimals)}${positionUnit(kind)}`;

const angles = ({ joints }: Planned, robot: Robot): string =>
  joints.map((value, i) => shownJoint(value, robot.joints[i]?.kind, 0)).join("  ");

export function loadOf({ force, anchor }: { force: readonly number[]; anchor: number | null }): string {
  const size = norm(force as unknown as Vector) || 1;
  const how = anchor === null ? alongText(force as unknown as Vector) : words.anchor(anchor + 1);
  return `${fixed(size, 0)} ${text.units.newton} ${how}`;
}

function Current({
  reading,
  robot,
  postures,
  index,
}: {
  reading: Planned;
  robot: Robot;
  postures: Posture[] | null;
  index: number;
}) {
  const posture = postures?.[index];
  const room = useMemo(() => roomOf(postures ?? []), [postures]);
  const show = useMemo(
    () =>
      posture && {
        posture,
        ...ARM_ALONE,
        load: { from: posture.flange_origin as Vector, along: reading.force as Vector },
        names: robot.joints.map(({ name }) => name),
      },
    [posture, reading],
  );
  return (
    <section class="card" aria-labelledby="current">
      <h2 id="current">{words.next(reading.label)}</h2>
      {show ? (
        <ArmView show={show} room={room} label={words.drawn(reading.label)} />
      ) : (
        <Busy label={text.scene.loading} />
      )}
      <p class="angles">
        {reading.joints.map((angle, i) => (
          <span>
            <small class="soft">{robot.joints[i]?.name}</small> <b>{shownJoint(angle, robot.joints[i]?.kind, 1)}</b>
          </span>
        ))}
      </p>
      <p>
        {text.next.load(loadOf(reading))}
        {reading.direction && `; ${words.readAlong(reading.direction.map((part) => fixed(part, 2)).join(", "))}`}
        {reading.validation && <span class="soft"> ({words.heldOut})</span>}
      </p>
    </section>
  );
}

interface Found {
  run: Run;
  fitted: number;
  held: number;
}

function Readings({ result, robot, done }: { result: PlanResult; robot: Robot; done: (labels: string[]) => void }) {
  const [found, setFound] = useState<Found | null>(null);
  const [fault, setFault] = useState<string | null>(null);
  const take = useAction(async (file: File) => {
    setFault(null);
    const set = await readingsOf(file);
    if (typeof set === "string") return setFault(set);
    const read = readSoFar(set);
    if (!read) return setFault(words.nothingRead);
    const held = result.readings.filter((each) => each.validation && read.labels.includes(each.label));
    if (held.length === read.labels.length) return setFault(words.nothingRead);
    const document = { ...read.document, robot_id: robot.id };
    const stored = await api.sets.add(document, contentKey("set", document));
    const request = { measurement_set_id: stored.id, leave_out: held.map(({ label }) => label) };
    const run = await api.runs.add(request, contentKey("run", request));
    setFound({ run, fitted: read.labels.length - held.length, held: held.length });
    done(result.readings.map(({ label }) => label).filter((label) => read.labels.includes(label)));
  });
  return (
    <section class="card" aria-labelledby="readings">
      <h2 id="readings">{words.readingsTitle}</h2>
      <DropZone
        title={words.drop}
        hint={words.dropHint}
        button={found ? words.dropAgain : text.files.choose}
        accept=".json,.csv,.tsv,.txt,application/json,text/csv"
        compact={found !== null}
        take={take.run}
      />
      {take.busy && <Busy label={text.files.checking} />}
      {fault && <p class="note warn">{fault}</p>}
      {take.problem && <ProblemNote problem={take.problem} />}
      {found && <HowSure found={found} result={result} />}
    </section>
  );
}

/** The measurement set in a file, with what is stated of a table; text that says what is wrong with it otherwise. */
export async function readingsOf(file: File, stated: ImportOptions = {}): Promise<Record<string, unknown> | string> {
  if (file.size > MAX_BYTES) return text.files.faults.too_large.join(" ");
  if (!/\.json$/i.test(file.name)) {
    const { measurement_set: set, missing } = await api.importFiles([file], stated);
    return set === null ? words.missing(missing.join(", ")) : (set as unknown as Record<string, unknown>);
  }
  const understood = understand(await file.text());
  return typeof understood === "string" ? text.files.faults[understood].join(" ") : understood.set;
}

function HowSure({ found: { run, fitted, held }, result }: { found: Found; result: PlanResult }) {
  if (run.error) return <ProblemNote problem={run.error} />;
  if (!run.result) return <a href={link(["runs", run.id])}>{words.run}</a>;
  const joints = surenessOf(result.joints, run.result.joints, run.result.budget);
  const open = joints.filter((joint) => !joint.enough);
  const worst = open.find(({ now }) => now === null) ?? [...open].sort((a, b) => (b.now ?? 0) - (a.now ?? 0))[0];
  const share = (value: number | null) => (value === null ? words.unknown : percent(value));
  return (
    <div aria-live="polite">
      <p class={worst ? "note" : "note good"}>
        <b>
          {!worst
            ? words.enough
            : worst.now === null
              ? words.keepOnUnknown(worst.name)
              : words.keepOn(worst.name, share(worst.now), share(worst.promised))}
        </b>
      </p>
      <DataTable
        caption={words.sure}
        table={{
          columns: [text.run.joint, words.sureColumns.now, words.sureColumns.promised],
          rows: joints.map((joint) => [joint.name, share(joint.now), share(joint.promised)]),
        }}
      />
      <p class="soft">
        {words.sure}. {words.counted(fitted, held)}. <Badge verdict={run.result.assessment.verdict} />{" "}
        <a href={link(["runs", run.id])}>{words.run}</a>
      </p>
    </div>
  );
}

const keyOf = (plan: string): string => `jointstiff.plan.${plan}`;

/** Which readings of a plan are done: kept in this browser, nowhere else. */
function useTicks(plan: string): [Set<string>, (labels: string[], done: boolean) => void] {
  const [ticks, set] = useState(() => read(plan));
  const change = (labels: string[], done: boolean) => {
    const next = new Set(ticks);
    for (const label of labels) done ? next.add(label) : next.delete(label);
    set(next);
    try {
      localStorage.setItem(keyOf(plan), JSON.stringify([...next]));
    } catch {
      // storage may be switched off: then they hold for this visit
    }
  };
  return [ticks, change];
}

function read(plan: string): Set<string> {
  try {
    const kept: unknown = JSON.parse(localStorage.getItem(keyOf(plan)) ?? "[]");
    return new Set(Array.isArray(kept) ? kept.filter((label) => typeof label === "string") : []);
  } catch {
    return new Set();
  }
}
