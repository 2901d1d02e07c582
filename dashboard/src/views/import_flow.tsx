/** From tables of readings to their result. Nothing is stored before the last tap. */
import { useEffect, useMemo, useState } from "preact/hooks";
import { api, problemOf } from "../api/client";
import type { ImportAnswer, ImportOptions, Problem, RobotSummary, Units } from "../api/types";
import { Busy, Button, Choice, LinkButton, ProblemNote } from "../components/basics";
import { Fields, Select } from "../components/fields";
import { text } from "../i18n";
import { later } from "../i18n/later";
import { Arm } from "../components/arm";
import { save } from "../components/download";
import { Findings, Preview } from "../components/findings";
import { MetadataForm } from "../components/metadata_form";
import { factsOf } from "../lib/campaign";
import { UNKNOWN, dimensionOf } from "../lib/columns";
import { significant } from "../lib/format";
import { contentKey, freshKey } from "../lib/hash";
import { notedIn } from "../lib/metadata";
import { noiseOf, statesNoise } from "../lib/noise";
import { unreadIn } from "../lib/json";
import type { Template } from "../lib/template";
import { useAction } from "../state/action";
import { valueOf } from "../state/load";
import { namesChanged, useNames } from "../state/names";
import { type Opened, freshDraft, keepDraft, keepFiles, keptDraft, keepTemplate } from "../state/opened";
import { link } from "../state/router";
import { FileDrop, GoBar, Step } from "./file_drop";
import { FrameForm, ImportForm, sent } from "./import_form";
import { ImportContent } from "./import_content";
import { Advanced, useRunForm } from "./advanced";

const words = later.imports;

export function ImportFlow({
  opened: { files, template },
  robot: asked,
  take,
}: {
  opened: Opened & { kind: "tables" };
  robot: string;
  take: (...files: File[]) => void;
}) {
  const known = valueOf(useNames());
  const begun = keptDraft(files) ?? freshDraft(template?.options ?? {});
  const [options, setOptions] = useState<ImportOptions>(begun.options);
  const [frame, setFrame] = useState(begun.frame);
  const [typed, setTyped] = useState(begun.typed);
  const [chosen, setChosen] = useState<string | null>(asked || null);
  const [joints, setJoints] = useState<number | null>(null);
  const form = useRunForm();
  useEffect(() => keepDraft({ options, frame, typed }), [options, frame, typed]);

  const robots = (known?.robots ?? [])
    .filter((one) => joints === null || one.joints.length === joints)
    .map((one) => ({ ...one, name: known?.robot(one.id) ?? one.name }));
  /** The only one that fits, until another one is chosen. */
  const robot = chosen ?? (robots.length === 1 ? (robots[0]?.id ?? "") : "");
  const framed = Object.values(frame).some(Boolean);
  const request = { ...sent(options), ...(robot && !framed ? { robot_id: robot } : {}) };
  const { answer, problem, busy } = useImport(files, request);
  useEffect(() => setJoints(answer?.preview.joint_count ?? null), [answer]);
  const set = answer?.measurement_set ?? null;
  const facts = set ? factsOf(set as never) : null;
  const length = facts?.units?.length ?? lengthOf(answer) ?? text.units.mm;
  const source = useMemo(() => (robot ? { robot_id: robot } : null), [robot]);
  const identify = useAction(async () => {
    if (!answer || !set) return;
    const noise = statesNoise(form.noise) ? noiseOf(form.noise, set.noise as never, set.units as Units) : set.noise;
    const robotId = answer.bodies.length > 0 ? await withBodies(robot, answer.bodies) : robot;
    const document = { ...set, ...notedIn(typed), noise, frame: framed ? frame : null, robot_id: robotId };
    const added = await api.sets.add(document, contentKey("set", document));
    namesChanged();
    if (answer.template) keepTemplate({ name: files[0]?.name ?? "", options: answer.template as ImportOptions });
    const run = await api.runs.add({ ...form.request(added.id), leave_out: answer.leave_out }, freshKey("run"));
    keepFiles(null);
    return link(["runs", run.id]);
  });
  const use = ({ options: kept }: Template) => setOptions(kept);

  return (
    <Fields action={identify} look="flow">
      <Step at={1} title={text.files.title} wide>
        <FileDrop again take={take} />
        {problem && <ProblemNote problem={problem} />}
        {answer ? (
          <ImportContent answer={answer} files={files} options={options} change={setOptions} use={use} />
        ) : (
          busy && <Busy label={words.readingFiles} />
        )}
      </Step>

      <Step at={2} title={words.rest}>
        {answer && <ImportForm answer={answer} options={options} change={setOptions} />}
        <RobotChoice robots={robots} label={(id) => known?.robot(id) ?? id} value={robot} change={setChosen} />
        <details open={framed}>
          <summary>{words.frameTitle}</summary>
          <FrameForm frame={frame} change={setFrame} robot={robot} length={length} />
        </details>
        <details>
          <summary>{later.metadata.title}</summary>
          <div class="import-form">
            <MetadataForm typed={typed} change={setTyped} />
          </div>
        </details>
        {known && robots.length === 0 && joints !== null && <p class="soft">{words.noRobot(joints)}</p>}
      </Step>

      <Step at={3} title={words.understood}>
        {facts && <Preview facts={facts} />}
        {answer && answer.bodies.length > 0 && (
          <p>
            {words.bodies(
              answer.bodies.length,
              significant(
                answer.bodies.reduce((sum, { mass }) => sum + mass, 0),
                4,
              ),
            )}
          </p>
        )}
        {answer?.findings && <Findings warnings={answer.findings} />}
        {source ? (
          <Arm source={source} start={facts?.firstJoints ?? null} sliders={false} />
        ) : (
          <p class="stage blank">{text.start.armHere}</p>
        )}
        {answer?.template && (
          <Button look="quiet" onClick={() => download(answer, files)}>
            {words.saveTemplate}
          </Button>
        )}
      </Step>

      <Advanced form={form} joints={robots.find(({ id }) => id === robot)?.joints.map((joint) => joint.name) ?? []} />
      <GoBar
        action={identify}
        ready={set !== null && robot !== "" && unreadIn(frame) === null && !busy && problem === null}
        why={busy ? null : (lackOf(answer, robot) ?? unreadIn(frame))}
      />
    </Fields>
  );
}

/** The robot with the masses of a table, stored as a robot of its own. */
async function withBodies(id: string, bodies: ImportAnswer["bodies"]): Promise<string> {
  const { name, model, joint_map } = await api.robots.one(id);
  const document = { name, model, joint_map, bodies };
  return (await api.robots.add(document, contentKey("robot", document))).id;
}

/** The unit of length of the files' columns; inches come as mm. */
function lengthOf(answer: ImportAnswer | null): string | null {
  const columns = answer?.preview.files.flatMap((file) => file.columns) ?? [];
  const unit = columns.find(({ meaning }) => dimensionOf(meaning) === "length")?.unit ?? null;
  return unit === "in" ? "mm" : unit;
}

/** Why it cannot be identified yet. */
function lackOf(answer: ImportAnswer | null, robot: string): string | null {
  if (!answer) return null;
  if (answer.preview.files.some(({ columns }) => columns.some(({ meaning }) => meaning === UNKNOWN))) {
    return words.columnsFirst;
  }
  if (answer.faults.length > 0) return words.faultsFirst(answer.faults.length);
  const [first] = answer.missing_fields;
  if (first !== undefined) return words.missing[first];
  return robot === "" ? text.start.robotFirst : null;
}

function download({ template }: ImportAnswer, files: File[]): void {
  save(JSON.stringify(template, null, 1), "application/json", `${files[0]?.name ?? "import"}.template.json`);
}

/** As many are in view. */
const IN_VIEW = 4;
const OTHERS = "others";

/** The robot that was measured: the newest few in view, the others in a list, or a new one. */
function RobotChoice({
  robots,
  label,
  value,
  change,
}: {
  robots: RobotSummary[];
  /** What a robot is called here, so that those of one name are told apart. */
  label: (id: string) => string;
  value: string;
  change: (robot: string) => void;
}) {
  const few = robots.slice(0, IN_VIEW);
  const [listed, setListed] = useState(false);
  const others = robots.length > IN_VIEW;
  const inList = listed || (value !== "" && !few.some(({ id }) => id === value));
  return (
    <>
      {few.length > 0 && (
        <Choice
          label={text.start.robot}
          value={inList && others ? OTHERS : value}
          change={(robot) => {
            setListed(robot === OTHERS);
            change(robot === OTHERS ? "" : robot);
          }}
          options={[
            ...few.map(({ id }) => ({ value: id, label: label(id) })),
            ...(others ? [{ value: OTHERS, label: later.imports.otherRobot }] : []),
          ]}
        />
      )}
      <div class="row">
        {inList && others && (
          <Select
            label={later.imports.otherRobot}
            value={value}
            change={change}
            options={[
              { value: "", label: text.start.pick },
              ...robots.slice(IN_VIEW).map(({ id }) => ({ value: id, label: label(id) })),
            ]}
          />
        )}
        <LinkButton href="#/robots/new">{later.robots.add}</LinkButton>
      </div>
    </>
  );
}

/** Someone who types is let finish before the files are sent again. */
const PAUSE_MS = 300;

interface Understood {
  answer: ImportAnswer | null;
  problem: Problem | null;
  /** Whether a newer answer is on its way. */
  busy: boolean;
}

/** While a new answer is on its way the last one stays, and counts as busy from the first moment. */
function useImport(files: File[], options: ImportOptions): Understood {
  const asked = JSON.stringify(options);
  const [{ of, ...heard }, set] = useState<Omit<Understood, "busy"> & { of: string | null }>({
    answer: null,
    problem: null,
    of: null,
  });
  useEffect(() => {
    const abort = new AbortController();
    const ask = () =>
      api.importFiles(files, { ...options, show_faults: true }, abort.signal).then(
        (answer) => abort.signal.aborted || set({ answer, problem: null, of: asked }),
        (error: unknown) =>
          abort.signal.aborted || set(({ answer }) => ({ answer, problem: problemOf(error), of: asked })),
      );
    const pause = setTimeout(() => void ask(), of === null ? 0 : PAUSE_MS);
    return () => {
      clearTimeout(pause);
      abort.abort();
    };
  }, [files, asked]);
  return { ...heard, busy: of !== asked };
}
