/** From tables of readings to their result. Nothing is stored before the last tap. */
import { keepPreviousData } from "@tanstack/query-core";
import { useEffect, useLayoutEffect, useRef, useState } from "preact/hooks";
import { api } from "../../api/calls";
import { queries } from "../../api/queries";
import type { ImportAnswer, Mapping, Units } from "../../api/types";
import { Busy, Button, LinkButton, ProblemNote, Prose } from "../../components/basics";
import { FittingRobot, RobotSelect } from "../../components/choosers";
import { RequestFields, TextField } from "../../components/fields";
import { Findings } from "../../components/findings";
import { MetadataForm, SchemaFields, type Terms, understood, useDescribed } from "../../components/schema_form";
import { saveJson } from "../../components/table";
import { formWords, metadataWords } from "../../components/words";
import { notedIn, noiseOf, statesNoise } from "../../lib/campaign";
import { significant } from "../../lib/format";
import { contentKey, type Fields, freshKey, unreadIn } from "../../lib/json";
import { sentence } from "../../lib/said";
import { OF_NUMBER, posted } from "../../lib/schema";
import { go, link, useAction } from "../../state/action";
import { likelyRobot, ROBOTS } from "../../state/choices";
import { recalled, remember } from "../../state/kept";
import { isKnown, useQuery } from "../../state/query";
import { text } from "../../words";
import { robotWords } from "../robots/words";
import { freshDraft, handFile, keepDraft, keepFiles, keptDraft } from "./begun";
import { TableEditor } from "./editor";
import { Advanced, FileDrop, GoBar, useRunForm } from "./flow";
import type { Opened } from "./opening";
import { importWords } from "./words";

const words = importWords;

interface FlowProps {
  opened: Opened & { kind: "tables" };
  robot: string;
  take: (...files: File[]) => void;
}

export function ImportFlow({ opened: { files, mapping: dropped }, robot: asked, take }: FlowProps) {
  const listed = useQuery(queries.robots(ROBOTS));
  const isDescribed = useDescribed();
  const [draft, setDraft] = useState(() => {
    const begun = keptDraft(files) ?? freshDraft(dropped ?? {}, null);
    return asked === "" || asked === begun.robot ? begun : { ...begun, ...ofRobot(asked, begun, dropped) };
  });
  const put = (part: Partial<typeof draft>) => setDraft((before) => ({ ...before, ...part }));
  useLayoutEffect(() => keepDraft(draft), [draft]);
  const form = useRunForm(files.map(({ name }) => name).join("/"));

  const likely = listed.data ? likelyRobot(listed.data, () => true) : "";
  const robot = draft.robot ?? likely;
  const request = { mapping: understoodIn(draft.mapping), ...(robot ? { robot_id: robot } : {}) };
  const { answer, problem, busy } = useImport(files, request, isKnown(listed));
  const isStated = (draft.mapping.tables ?? []).length > 0;
  const mapping = isStated || !answer ? draft.mapping : answer.mapping;
  const change = (next: Mapping) => put({ mapping: next });
  const choose = (next: string) => put(ofRobot(next, { ...draft, robot }, dropped));

  const set = answer?.faults.length === 0 ? answer.measurement_set : null; // with faults it is only inspected
  const identify = useAction(async () => {
    if (!set) return;
    const noise = statesNoise(form.noise) ? noiseOf(form.noise, set.noise as never, set.units as Units) : set.noise;
    const document = { ...set, ...notedIn(draft.typed), noise, robot_id: robot };
    const added = await api.sets.add(document, contentKey("set", document));
    const run = await api.runs.add(form.request(added.id), freshKey("run"));
    keepStated(robot, mapping);
    keepFiles(null);
    return link(["runs", run.id]);
  });
  const about = useRef<HTMLElement>(null);
  const open = answer?.questions.length;
  const before = useRef(open);
  useEffect(() => {
    const top = about.current?.getBoundingClientRect().top ?? 0;
    // What the robot says of an answer is above the question, which a phone has scrolled away.
    if (before.current !== undefined && top < 0) about.current?.scrollIntoView();
    before.current = open;
  }, [open]);
  const known = listed.data?.items.find(({ id }) => id === robot)?.joints ?? [];
  const goesElsewhere = (answer?.weight_step ?? answer?.geometry ?? null) !== null;
  const check = busy ? words.checking : (problem?.detail ?? checkOf(answer));

  return (
    <RequestFields action={identify} look="import" known={isDescribed && isKnown(listed)}>
      <section class="card about" ref={about}>
        <div class="row">
          <FileDrop again take={take} />
          {mapping.tables && mapping.tables.length > 0 && (
            <Button look="quiet" onClick={() => saveJson(mapping, `${files[0]?.name ?? "import"}.mapping.json`)}>
              {words.saveMapping}
            </Button>
          )}
          {robot !== "" && (
            <RobotSelect label={text.start.robot} value={robot} change={choose} none={text.start.pick} several />
          )}
        </div>
        {robot === "" && <WhichRobot change={choose} count={listed.data?.items.length ?? 0} />}
        {problem && <ProblemNote problem={problem} />}
        {answer ? <Said answer={answer} busy={busy} /> : busy && <Busy label={words.readingFiles} />}
        {answer && (
          <NextQuestion
            key={answer.questions[0]?.text}
            {...{ answer, robot, change }}
            isFirst={before.current === undefined}
          />
        )}
        {answer && <OtherWay answer={answer} files={files} />}
      </section>
      {!answer?.weight_step &&
        answer?.tables.map((table) => (
          <TableEditor key={table.name} {...{ table, mapping, change, check }} joints={known.length} />
        ))}
      {!goesElsewhere && (
        <>
          {answer && <StatedFields mapping={mapping} change={change} />}
          <details class="card">
            <summary>{metadataWords.title}</summary>
            <div class="fields">
              <MetadataForm typed={draft.typed} change={(typed) => put({ typed })} />
            </div>
          </details>
          <Advanced form={form} joints={known.map(({ name }) => name)} />
          <GoBar
            action={identify}
            ready={set !== null && robot !== "" && !busy && problem === null}
            why={busy ? words.checking : lackOf(answer, robot)}
          />
        </>
      )}
    </RequestFields>
  );
}

/** A robot, and the mapping without what another robot proposed; a mapping from a file is of any robot. */
function ofRobot(robot: string, before: { mapping: Mapping; robot: string | null }, dropped: Mapping | null) {
  const isOfAnother = before.robot && before.robot !== robot && dropped === null;
  return { robot, mapping: { ...before.mapping, ...(isOfAnother ? { tables: [], doubts: [], frame: null } : {}) } };
}

/** What files do not say: stated before it is asked, or corrected afterwards. */
function StatedFields({ mapping, change }: { mapping: Mapping; change: (mapping: Mapping) => void }) {
  const [open, setOpen] = useState(false);
  return (
    <details class="card" open={open} onToggle={(event) => setOpen(event.currentTarget.open)}>
      <summary>{words.stated}</summary>
      {open && (
        <SchemaFields
          of="Mapping"
          show={["encoders", "load_point", "load_point_target", "force", "flange_targets"]}
          value={mapping as Fields}
          change={(next) => change(next)}
          terms={TERMS}
        />
      )}
    </details>
  );
}

/** What can be sent: without fields whose text is not understood yet. */
const understoodIn = (mapping: Mapping): Mapping =>
  Object.fromEntries(Object.entries(mapping).filter(([, value]) => value !== null && unreadIn(value) === null));

const TERMS: Terms = {
  labels: words.labels,
  units: {
    force: [text.units.newton, 1],
    load_point: [text.units.mm, 1],
    flange_targets: [text.units.mm, 1],
  },
};

/** What the check says first of a mapping. */
const checkOf = (answer: ImportAnswer | null): string =>
  sentence(answer?.faults[0] ?? answer?.questions[0]?.text ?? answer?.sentence ?? "");

/** Why the readings cannot be identified yet. */
export function lackOf(answer: ImportAnswer | null, robot: string): string | null {
  if (robot === "") return words.open.robot;
  if (!answer) return null;
  if (answer.questions.length > 0) return words.open.questions(answer.questions.length);
  return answer.faults.length > 0 ? words.open.faults : null;
}

const WhichRobot = ({ change, count }: { change: (robot: string) => void; count: number }) => (
  <div class="ask">
    <h2>{words.open.robot}</h2>
    {count === 0 && <p>{words.noRobots}</p>}
    <FittingRobot label={text.start.robot} value="" change={change} none={text.start.pick} fits={() => true} />
    <p>
      <LinkButton href="#/robots/new">{robotWords.add}</LinkButton>
    </p>
  </div>
);

const MOST_FAR = 5;

/** What the robot says of the readings, and what is wrong with them. */
function Said({ answer, busy }: { answer: ImportAnswer; busy: boolean }) {
  const { sentence: said, faults, far, findings, questions } = answer;
  const look = faults.length > 0 ? "bad" : questions.length > 0 ? "warn" : "good";
  const farthest = [...far].sort((one, other) => other.distance - one.distance);
  return (
    <div class={busy ? "said stale" : "said"}>
      {(said || faults.length > 0) && (
        <div class={`note ${look}`} role={faults.length > 0 ? "alert" : undefined}>
          {[said, ...faults].filter(Boolean).map((each) => (
            <p>
              <Prose text={sentence(each)} />
            </p>
          ))}
          {far.length > 0 && (
            <ul>
              {farthest.slice(0, MOST_FAR).map((one) => (
                <li>
                  <bdi>{words.far(one, significant(one.distance, 2))}</bdi>
                </li>
              ))}
              {far.length > MOST_FAR && <li>{text.more(far.length - MOST_FAR)}</li>}
            </ul>
          )}
        </div>
      )}
      {findings && <Findings warnings={findings} />}
    </div>
  );
}

const GRAVITY = 9.80665; // m/s², standard gravity

interface QuestionProps {
  answer: ImportAnswer;
  robot: string;
  change: (mapping: Mapping) => void;
  /** Whether no question was answered yet. */
  isFirst: boolean;
}

/** The next question, with its answers as buttons, or with boxes for what a person states. */
function NextQuestion({ answer: { questions, mapping }, robot, change, isFirst }: QuestionProps) {
  const [stated, setStated] = useState<Fields>({});
  const [mass, setMass] = useState("");
  const form = useRef<HTMLFormElement>(null);
  useEffect(() => {
    if (!isFirst) form.current?.querySelector<HTMLElement>("input, textarea")?.focus({ preventScroll: true });
  }, []);
  const [question] = questions;
  if (!question) return null;
  const { field, choices } = question;
  const isTyped = field === "load_point" || field === "force" || field === "flange_targets";
  const weight = posted(mass, GRAVITY);
  const force = typeof weight === "number" ? { force: [0, 0, -weight] } : {};
  const answers = { ...stated, ...force };
  const isReady = Object.values(answers).some(Boolean) && unreadIn(answers) === null;
  const ownHelp = OF_NUMBER.read(mass) === undefined ? formWords.unread(mass) : understood(OF_NUMBER, mass, "kg");
  const last = field === null || field === "tables" ? {} : lackingOf(lastStated(robot), mapping);
  return (
    <form
      class="ask"
      ref={form}
      onKeyDown={(event) => {
        if (event.key !== "Enter" || event.target instanceof HTMLButtonElement || field === "flange_targets") return;
        event.preventDefault(); // a box of one line, which grows, has no Enter of its own
        form.current?.requestSubmit();
      }}
      onSubmit={(event) => {
        event.preventDefault();
        if (isReady) change({ ...mapping, ...answers } as Mapping);
      }}
    >
      <h2>
        <Prose text={sentence(question.text)} />
      </h2>
      {choices.length > 0 && (
        <div class="actions">
          {choices.map((choice) => (
            <Button onClick={() => change(choice.mapping)}>{formWords.values[choice.text] ?? choice.text}</Button>
          ))}
        </div>
      )}
      {field !== null && field in last && (
        <Button onClick={() => change({ ...mapping, ...last })}>{words.asLast(last)}</Button>
      )}
      {field === "tables" && <p class="soft">{words.hint}</p>}
      {isTyped && (
        <>
          {field === "force" && (
            <TextField
              label={words.mass}
              unit="kg"
              help={ownHelp ?? words.massHelp}
              aria-invalid={OF_NUMBER.read(mass) === undefined}
              value={mass}
              change={setMass}
            />
          )}
          <SchemaFields
            of="Mapping"
            show={field === "load_point" ? ["load_point", "load_point_target"] : [field]}
            value={stated}
            change={setStated}
            terms={field === "force" ? { ...TERMS, labels: { force: words.orForce } } : TERMS}
          />
          <Button type="submit" look="primary" disabled={!isReady}>
            {words.next}
          </Button>
        </>
      )}
    </form>
  );
}

/** What files of a robot did not say, and what a person stated. */
type Stated = Pick<Mapping, "encoders" | "load_point" | "load_point_target" | "force">;

const keptName = (robot: string): string => `stated/${robot}`;

const lastStated = (robot: string): Stated => (recalled(keptName(robot)) ?? {}) as Stated;

const keepStated = (robot: string, { encoders, load_point, load_point_target, force }: Mapping): void =>
  remember(keptName(robot), { encoders, load_point, load_point_target, force });

/** What was stated last time and a mapping lacks. */
const lackingOf = (last: Stated, mapping: Mapping): Stated =>
  Object.fromEntries(Object.entries(last).filter(([name, value]) => value && !mapping[name as keyof Stated]));

/** Where files go on that have no readings of stiffness: a weight step to the gearboxes, poses to a file. */
function OtherWay({ answer: { weight_step: step, geometry }, files }: { answer: ImportAnswer; files: File[] }) {
  const [first] = files;
  if (step && first)
    return (
      <div class="ask">
        <p>{words.weightStep}</p>
        <Button
          look="primary"
          onClick={() => {
            handFile(first);
            go("#/gearboxes");
          }}
        >
          {words.toGearboxes}
        </Button>
      </div>
    );
  if (!geometry) return null;
  return (
    <div class="ask">
      <p>{words.poses}</p>
      <Button look="primary" onClick={() => saveJson(geometry, "poses.json")}>
        {words.savePoses}
      </Button>
    </div>
  );
}

/** Someone who types is let finish before the files are sent again. */
const PAUSE_MS = 300;

/** How often files were opened. */
let opened = 0;

/** While a new answer is on its way the last one stays, and counts as busy from the first moment. */
function useImport(files: File[], request: { mapping: Mapping; robot_id?: string }, isReady: boolean) {
  const isFirst = useRef(true);
  const [number] = useState(() => ++opened); // a key is JSON, which files are not
  const { data, problem, isFetching, isStand } = useQuery({
    queryKey: ["import", number, request],
    queryFn: async ({ signal }) => {
      if (!isFirst.current) await new Promise((done) => setTimeout(done, PAUSE_MS));
      isFirst.current = false;
      signal.throwIfAborted();
      return api.importFiles(files, request, signal);
    },
    enabled: isReady,
    staleTime: "static",
    gcTime: 0,
    placeholderData: keepPreviousData,
  });
  const last = useRef<ImportAnswer | null>(null); // remains in view while the service refuses what is stated
  if (data) last.current = data;
  const busy = isFetching || isStand;
  return { answer: last.current, problem: busy ? null : problem, busy };
}
