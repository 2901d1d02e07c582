/** From tables of readings to their result. Nothing is stored before the last tap. */
import { keepPreviousData } from "@tanstack/query-core";
import { useState, useMemo, useRef, useEffect, useLayoutEffect } from "preact/hooks";
import { api } from "../../api/calls";
import { queries } from "../../api/queries";
import type { ImportAnswer, ImportOptions, Units } from "../../api/types";
import { Prose, Button, Choice, Busy, LinkButton, ProblemNote } from "../../components/basics";
import { TextField, RequestFields } from "../../components/fields";
import { SchemaFields, type Terms, MetadataForm, understood, useDescribed } from "../../components/schema_form";
import { OF_NUMBER, posted } from "../../lib/schema";
import { type Fields, unreadIn, contentKey, freshKey } from "../../lib/json";
import { FittingRobot } from "../../components/choosers";
import { likelyRobot, ROBOTS } from "../../state/choices";
import { isKnown, useQuery } from "../../state/query";
import { text } from "../../words";
import { meaningsFor, widthOf, fits, maybeJoints, UNKNOWN, dimensionOf } from "./imports";
import { keptTemplates, freshDraft, keepDraft, keepFiles, keptDraft, keepTemplate } from "./begun";
import type { Opened } from "./opening";
import { Assumptions, FaultList, ImportTable } from "./import_table";
import { Arm } from "../../scene/view";
import { saveJson } from "../../components/table";
import { Findings, Preview } from "../../components/findings";
import { factsOf, notedIn, noiseOf, statesNoise } from "../../lib/campaign";
import { significant } from "../../lib/format";
import { useAction, link } from "../../state/action";
import { FileDrop, GoBar, Step, Advanced, NOISE, useRunForm } from "./flow";
import { importWords } from "./words";
import { formWords, metadataWords } from "../../components/words";
import { robotWords } from "../robots/words";

const words = importWords;

const GRAVITY = 9.80665; // m/s², standard gravity

/** Unit of the lengths that are stated: that of a template that has some, its noise among them; else mm, whatever the files have. */
const lengthOf = ({ length_unit: unit, units, ...stated }: ImportOptions): string => {
  const ofTemplate = stated.load_point || stated.flange_targets || stated.noise ? units?.length : null;
  return unit ?? ofTemplate ?? text.units.mm;
};

const termsOf = (options: ImportOptions): Terms => ({
  labels: words.labels,
  inView: ["encoders"],
  units: {
    force: [options.units?.force ?? text.units.newton, 1],
    load_point: [lengthOf(options), 1],
    flange_targets: [lengthOf(options), 1],
  },
});

const ASKED = ["force", "load_point", "load_point_target", "flange_targets", "accept_unusual"] as const;

/** The options with what is stated, and its units. */
export function withStated(before: ImportOptions, next: Fields): ImportOptions {
  const { load_point: point, flange_targets: targets, force, units } = next as ImportOptions;
  return {
    ...next,
    ...(force ? { units: { ...units, force: before.units?.force ?? "N" } } : {}),
    ...(point || targets ? { length_unit: lengthOf(before) } : {}),
  } as ImportOptions;
}

/** What can be sent: without what is not understood yet, or was taken back. */
export const sent = (options: ImportOptions): ImportOptions =>
  Object.fromEntries(Object.entries(options).filter(([, value]) => value !== null && unreadIn([value]) === null));

interface ImportProps {
  answer: ImportAnswer;
  options: ImportOptions;
  change: (options: ImportOptions) => void;
}

/** What the files do not say. */
function ImportForm({ answer, options, change }: ImportProps) {
  const [mass, setMass] = useState("");
  const misread = OF_NUMBER.read(mass) === undefined;
  const missing = new Set<string>(answer.missing_fields);
  if (missing.has("load_point")) {
    missing.add("load_point_target"); // either of the two states the load point
  }
  const form = {
    of: "ImportRequest",
    value: options as Fields,
    change: (next: Fields) => change(withStated(options, next)),
    terms: termsOf(options),
  };
  const unusual = answer.missing.filter((_, i) => answer.missing_fields[i] === "accept_unusual");
  return (
    <div class="import-form">
      <SchemaFields {...form} show={["encoders", ...ASKED.filter((name) => missing.has(name) || options[name])]} />
      {(missing.has("force") || mass) && (
        <TextField
          label={words.mass}
          unit="kg"
          help={misread ? formWords.unread(mass) : (understood(OF_NUMBER, mass, "kg") ?? words.massHelp)}
          aria-invalid={misread}
          value={mass}
          change={(typed) => {
            setMass(typed);
            const weight = posted(typed, GRAVITY);
            const force = typeof weight === "number" ? [0, 0, -weight] : null;
            change({ ...options, force, units: { ...options.units, force: "N" } } as ImportOptions);
          }}
        />
      )}
      {unusual.map((asked) => (
        <p class="note warn">
          <Prose text={asked} />
        </p>
      ))}
      <SchemaFields {...form} show={["name"]} />
    </div>
  );
}

interface FrameProps {
  frame: Fields;
  change: (frame: Fields) => void;
  /** Whose geometries are offered; empty while none is chosen. */
  robot: string;
  /** The files' unit of length. */
  length: string;
}

/** The frame of the positions, where it is a tracker's: by a geometry of the robot, or by a transform. */
function FrameForm({ frame, change, robot, length }: FrameProps) {
  const { data: geometries } = useQuery({
    ...queries.geometries({ robot_id: robot, state: "succeeded", limit: 20 }),
    enabled: robot !== "",
  });
  const terms: Terms = {
    labels: words.frame,
    within: "frame.",
    units: { translation: [length, 1] },
    choices: {
      geometry_id: [
        { value: "", label: words.noGeometry },
        ...(geometries?.items ?? []).map(({ id, name }) => ({ value: id, label: name ?? id })),
      ],
    },
  };
  const by = frame["geometry_id"] ? [] : ["translation", "rotation"];
  return (
    <>
      <SchemaFields of="Frame" show={["geometry_id", ...by, "forces"]} value={frame} change={change} terms={terms} />
      <p class="soft">{words.later}</p>
    </>
  );
}

/** The meaning that the robot proposes for columns without known names, and the tap that accepts or leaves the meaning. */
function Proposal({ answer: { proposal }, options, change }: ImportProps) {
  if (!proposal) return null;
  const accepted = options.accept_proposal === true;
  return (
    <div class="note good row">
      <p>
        {accepted && `${words.byProposal} `}
        {proposal}
      </p>
      <Button
        {...(accepted ? { look: "quiet" } : {})}
        onClick={() => change({ ...options, accept_proposal: !accepted })}
      >
        {accepted ? words.withoutProposal : words.takeProposal}
      </Button>
    </div>
  );
}

/** What was read of the files, column by column, and what is wrong with it. */
function ImportContent({ answer, files, options, change, robot }: ImportProps & { files: File[]; robot: string }) {
  const { faults } = answer;
  const groups = useMemo(() => meaningsFor(answer.files, answer.targets), [answer]);
  const named = new Set(answer.files.map(({ file }) => file));
  const offered = useMemo(() => keptTemplates().find((one) => fits(one, answer)), [answer]);
  const inUse = (options.layouts ?? []).length > 0;
  return (
    <>
      {offered && !inUse && (
        <div class="note good row">
          <p>{words.fits(offered.name)}</p>
          <Button onClick={() => change(offered.options)}>{words.useTemplate}</Button>
        </div>
      )}
      {inUse && (
        <div class="row by-template">
          <span class="soft">{words.byTemplate}</span>
          <Button look="quiet" onClick={() => change({})}>
            {words.withoutTemplate}
          </Button>
        </div>
      )}
      <Proposal {...{ answer, options, change }} />
      <FaultList faults={faults.filter(({ file }) => file === null || !named.has(file))} />
      <ImportReading {...{ answer, files, options, change }} />
      {answer.files.map((one) => (
        <ImportTable
          key={one.file}
          preview={one}
          faults={faults.filter(({ file }) => file === one.file)}
          options={options}
          change={change}
          groups={groups}
          robot={robot}
        />
      ))}
      <Assumptions of={answer.assumptions} />
    </>
  );
}

const readingWords = words.reading;

/** How files are read where that is not plain: controls for the options that faults name, and for those that are set. */
function ImportReading({ answer: { faults }, files, options, change }: ImportProps & { files: File[] }) {
  const named = new Set(faults.map((fault) => fault.option));
  const shown = (option: keyof ImportOptions & string) => named.has(option) || Boolean(options[option]);
  const put = (part: Partial<ImportOptions>) => change({ ...options, ...part });
  const headless = files.find((file) => faults.some((fault) => fault.option === "header" && fault.file === file.name));
  const stated = Object.keys(options.state_words ?? {});
  const asked = faults.find((fault) => fault.option === "state_words" && fault.words.length === 2)?.words;
  const offered = faults.find((fault) => fault.option === "sheet")?.words;
  const known = useRef<string[]>([]); // once one is chosen, no fault names them
  if (offered && offered.length > 0) known.current = offered;
  const sheets = known.current.length > 0 ? known.current : options.sheet ? [options.sheet] : [];
  const stateless = shown("state");
  const pair = asked ?? (stated.length === 2 ? stated : null);
  const terms: Terms = {
    labels: readingWords.texts,
    choices: {
      sheet: ["", ...sheets, ...(sheets.length > 1 ? [sheets.join("; ")] : [])].map((name) => ({
        value: name,
        label: name || readingWords.pickSheet,
      })),
    },
  };
  return (
    <div class="import-form">
      {headless && !/\.(xlsx|mat|h5|hdf5|parquet)$/i.test(headless.name) && (
        <Button onClick={() => void headless.text().then((content) => put({ header: unnamed(content) }))}>
          {readingWords.nameColumns}
        </Button>
      )}
      {stateless && (
        <Choice
          label={readingWords.state}
          value={options.state ?? ""}
          change={(state) => put({ state: state as NonNullable<ImportOptions["state"]> })}
          options={Object.entries(readingWords.states).map(([value, label]) => ({ value, label }))}
        />
      )}
      {pair && (
        <Choice
          label={readingWords.unloadedWord}
          value={pair.find((word) => options.state_words?.[word] === "unloaded") ?? ""}
          change={(unloaded) =>
            put({
              state_words: {
                ...options.state_words,
                ...Object.fromEntries(pair.map((word) => [word, word === unloaded ? "unloaded" : "loaded"] as const)),
              },
            })
          }
          options={pair.map((word) => ({ value: word, label: word }))}
        />
      )}
      <SchemaFields
        of="ImportRequest"
        show={READING.filter(shown)}
        value={options as Fields}
        change={change}
        terms={terms}
      />
    </div>
  );
}

/** Options of how files are read that are asked for where a fault names them. */
const READING = [
  "decimal_mark",
  "delimiter",
  "allow_missing",
  "mean_of_repeats",
  "joint_tolerance",
  "by_order",
  "sheet",
  "point_name",
  "file_name",
] as const;

/** A header by which no column is used yet: the table is shown, and each is given its meaning there. */
const unnamed = (content: string): string[] => Array.from({ length: widthOf(content) }, () => "ignore");

interface FlowProps {
  opened: Opened & { kind: "tables" };
  robot: string;
  take: (...files: File[]) => void;
}

export function ImportFlow({ opened: { files, template }, robot: asked, take }: FlowProps) {
  const listed = useQuery(queries.robots(ROBOTS));
  const isDescribed = useDescribed();
  const [draft, setDraft] = useState(() => keptDraft(files) ?? freshDraft(template?.options ?? {}));
  const { options, frame, typed } = draft;
  const put = (part: Partial<typeof draft>) => setDraft((before) => ({ ...before, ...part }));
  const change = (next: ImportOptions) => put({ options: next });
  const [chosen, setChosen] = useState<string | null>(asked || null);
  const [joints, setJoints] = useState<number | null>(null);
  const form = useRunForm(files.map(({ name }) => name).join("/"));
  useLayoutEffect(() => keepDraft(draft), [draft]);

  const canBeOf = (one: { joints: readonly unknown[] }) => joints === null || one.joints.length === joints;
  const robots = (listed.data?.items ?? []).filter(canBeOf);
  const cannotFit = listed.data?.items.some((one) => one.id === chosen && !canBeOf(one)) ?? false;
  const likely = chosen === null && listed.data ? likelyRobot(listed.data, canBeOf) : "";
  const robot = cannotFit ? "" : (chosen ?? likely);
  const framed = Object.values(frame).some(Boolean);
  const request = { ...sent(options), ...(robot && !framed ? { robot_id: robot } : {}) };
  const { answer, problem, busy } = useImport(files, request);
  useEffect(() => setJoints(answer?.joint_count ?? null), [answer]);
  const set = answer?.measurement_set ?? null;
  const bodies = answer?.bodies ?? [];
  const mass = bodies.reduce((sum, body) => sum + body.mass, 0);
  const facts = set ? factsOf(set as never) : null;
  const length = facts?.units?.length ?? lengthOfFiles(answer) ?? text.units.mm;
  const identify = useAction(async () => {
    if (!answer || !set) return;
    const noise = statesNoise(form.noise) ? noiseOf(form.noise, set.noise as never, set.units as Units) : set.noise;
    const robotId = bodies.length > 0 ? await withBodies(robot, bodies) : robot;
    const document = { ...set, ...notedIn(typed), noise, frame: framed ? frame : null, robot_id: robotId };
    const added = await api.sets.add(document, contentKey("set", document));
    if (answer.template) keepTemplate({ name: files[0]?.name ?? "", options: answer.template as ImportOptions });
    const run = await api.runs.add({ ...form.request(added.id), leave_out: answer.leave_out }, freshKey("run"));
    keepFiles(null);
    return link(["runs", run.id]);
  });

  return (
    <RequestFields action={identify} look="flow" known={isDescribed && isKnown(listed)}>
      <Step at={1} title={text.files.title} wide>
        <FileDrop again take={take} />
        {problem && <ProblemNote problem={problem} />}
        {answer ? (
          <ImportContent {...{ answer, files, options, change, robot }} />
        ) : (
          busy && <Busy label={words.readingFiles} />
        )}
      </Step>

      <Step at={2} title={words.rest}>
        {answer && <ImportForm {...{ answer, options, change }} />}
        <FittingRobot label={text.start.robot} value={robot} change={setChosen} none={text.start.pick} fits={canBeOf} />
        <p>
          <LinkButton href="#/robots/new">{robotWords.add}</LinkButton>
        </p>
        <details open={framed}>
          <summary>{words.frameTitle}</summary>
          <FrameForm frame={frame} change={(next) => put({ frame: next })} robot={robot} length={length} />
        </details>
        <SchemaFields of="Noise" show={["grounds"]} value={form.noise} change={form.setNoise} terms={NOISE} />
        <details>
          <summary>{metadataWords.title}</summary>
          <div class="import-form">
            <MetadataForm typed={typed} change={(next) => put({ typed: next })} />
          </div>
        </details>
        {listed.data && robots.length === 0 && joints !== null && <p class="soft">{words.noRobot(joints)}</p>}
      </Step>

      <Step at={3} title={words.understood}>
        {facts && <Preview facts={facts} />}
        {answer?.weight_step && (
          <p>
            {words.weightStep} <LinkButton href="#/gearboxes">{words.toGearboxes}</LinkButton>
          </p>
        )}
        {bodies.length > 0 && <p>{words.bodies(bodies.length, significant(mass, 4))}</p>}
        {answer?.findings && <Findings warnings={answer.findings} />}
        <Arm source={robot ? { robot_id: robot } : null} start={facts?.firstJoints ?? null} sliders={false} />
        {answer?.template && (
          <Button look="quiet" onClick={() => saveJson(answer.template, `${files[0]?.name ?? "import"}.template.json`)}>
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
    </RequestFields>
  );
}

/** The robot with the masses of a table, stored as a robot of its own. */
async function withBodies(id: string, bodies: ImportAnswer["bodies"]): Promise<string> {
  const { name, model, joint_map, payload = null } = await api.robots.one(id);
  const document = { name, model, joint_map, payload, bodies };
  return (await api.robots.add(document, contentKey("robot", document))).id;
}

/** The unit of length of the files' columns; inches come as mm. */
function lengthOfFiles(answer: ImportAnswer | null): string | null {
  const columns = answer?.files.flatMap((file) => file.columns) ?? [];
  const unit = columns.find(({ meaning }) => dimensionOf(meaning) === "length")?.unit ?? null;
  return unit === "in" ? "mm" : unit;
}

/** Why it cannot be identified yet. */
export function lackOf(answer: ImportAnswer | null, robot: string): string | null {
  if (!answer) return null;
  if (answer.files.some(({ columns }) => columns.some(({ meaning }) => meaning === UNKNOWN))) {
    return robot === "" && answer.files.some((file) => maybeJoints(file).length > 0)
      ? words.robotFirst
      : words.columnsFirst;
  }
  if (answer.faults.length > 0) return words.faultsFirst(answer.faults.length);
  const missing = [...new Set(answer.missing_fields)];
  if (missing.length > 0) return missing.map((field) => words.missing[field]).join(". ");
  return robot === "" ? text.start.robotFirst : null;
}

/** Someone who types is let finish before the files are sent again. */
const PAUSE_MS = 300;

/** How often files were opened. */
let opened = 0;

/** While a new answer is on its way the last one stays, and counts as busy from the first moment. */
function useImport(files: File[], options: ImportOptions) {
  const isFirst = useRef(true);
  const [number] = useState(() => ++opened); // a key is JSON, which files are not
  const { data, problem, isFetching, isStand } = useQuery({
    queryKey: ["import", number, options],
    queryFn: async ({ signal }) => {
      if (!isFirst.current) await new Promise((go) => setTimeout(go, PAUSE_MS));
      isFirst.current = false;
      signal.throwIfAborted();
      return api.importFiles(files, { ...options, show_faults: true }, signal);
    },
    staleTime: "static",
    gcTime: 0,
    placeholderData: keepPreviousData,
  });
  const last = useRef<ImportAnswer | null>(null); // stays in view while the service refuses what is stated
  if (data) last.current = data;
  const busy = isFetching || isStand;
  return { answer: last.current, problem: busy ? null : problem, busy };
}
