/** From tables of readings to their result. Nothing is stored before the last tap. */
import { useEffect, useMemo, useState } from "preact/hooks";
import { api } from "../api/client";
import type { ImportAnswer, ImportOptions, Units } from "../api/types";
import { Arm } from "../components/arm";
import { Busy, Button, ProblemNote } from "../components/basics";
import { save } from "../components/download";
import { Findings } from "../components/findings";
import { MetadataForm } from "../components/metadata_form";
import { Preview } from "../components/preview";
import { factsOf } from "../lib/campaign";
import { dimensionOf, UNKNOWN } from "../lib/columns";
import { frameOf } from "../lib/frame";
import { contentKey, freshKey } from "../lib/hash";
import { notedIn } from "../lib/metadata";
import { noiseOf, statesNoise } from "../lib/noise";
import { type Stated, statedIn, withStated } from "../lib/stated";
import type { Template } from "../lib/template";
import { useAction } from "../state/action";
import { useImport } from "../state/import";
import { valueOf } from "../state/load";
import { namesChanged, useNames } from "../state/names";
import { freshDraft, keepDraft, keepFiles, keptDraft, type Opened } from "../state/opened";
import { go, link } from "../state/router";
import { keepTemplate } from "../state/templates";
import { text } from "../i18n";
import { FileDrop } from "./file_drop";
import { FrameForm } from "./frame_form";
import { GoBar } from "./go_bar";
import { ImportContent } from "./import_content";
import { ImportForm } from "./import_form";
import { Advanced, useRunForm } from "./advanced";
import { RobotChoice } from "./robot_choice";

const words = text.imports;

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
  const [stated, setStated] = useState<Stated>(begun.stated);
  const [frame, setFrame] = useState(begun.frame);
  const [typed, setTyped] = useState(begun.typed);
  const [chosen, setChosen] = useState<string | null>(asked || null);
  const [joints, setJoints] = useState<number | null>(null);
  const form = useRunForm();
  keepDraft(files, { options, stated, frame, typed });

  const robots = (known?.robots ?? [])
    .filter((one) => joints === null || one.joints.length === joints)
    .map((one) => ({ ...one, name: known?.robot(one.id) ?? one.name }));
  /** The newest that fits, until another one is chosen. */
  const robot = chosen ?? (joints !== null || robots.length === 1 ? (robots[0]?.id ?? "") : "");
  const request = { ...withStated(options, stated), ...(robot && frame.of === "" ? { robot_id: robot } : {}) };
  const { answer, problem, busy } = useImport(files, request);
  useEffect(() => setJoints(answer?.preview.joint_count ?? null), [answer]);
  const set = answer?.measurement_set ?? null;
  const facts = set ? factsOf(set as never) : null;
  const length = facts?.units?.length ?? lengthOf(answer) ?? text.units.mm;
  const source = useMemo(() => (robot ? { robot_id: robot } : null), [robot]);
  const framed = frameOf(frame);
  const identify = useAction(async () => {
    if (!answer || !set) return;
    const noise = statesNoise(form.noise) ? noiseOf(form.noise, set.noise as never, set.units as Units) : set.noise;
    const document = { ...set, ...notedIn(typed), noise, frame: framed, robot_id: robot };
    const added = await api.sets.add(document, contentKey("set", document));
    namesChanged();
    if (answer.template) keepTemplate({ name: files[0]?.name ?? "", options: answer.template as ImportOptions });
    const run = await api.runs.add({ ...form.request(added.id), leave_out: answer.leave_out }, freshKey("run"));
    keepFiles(null);
    go(link(["runs", run.id]));
  });
  const use = ({ options: kept }: Template) => {
    setOptions(kept);
    setStated(statedIn(kept));
  };

  return (
    <div class="flow">
      <section class="card wide" aria-labelledby="step-file">
        <h2 id="step-file">
          <span class="step">1</span>
          {text.files.title}
        </h2>
        <FileDrop again take={take} />
        {problem && <ProblemNote problem={problem} />}
        {answer ? (
          <ImportContent answer={answer} files={files} options={options} change={setOptions} use={use} />
        ) : (
          busy && <Busy label={words.readingFiles} />
        )}
      </section>

      <section class="card" aria-labelledby="step-rest">
        <h2 id="step-rest">
          <span class="step">2</span>
          {words.rest}
        </h2>
        {answer && <ImportForm answer={answer} stated={stated} change={setStated} />}
        <RobotChoice robots={robots} label={(id) => known?.robot(id) ?? id} value={robot} change={setChosen} />
        {chosen === null && robot !== "" && robots.length > 1 && joints !== null && (
          <p class="soft">{words.newestRobot(joints)}</p>
        )}
        <details open={frame.of !== ""}>
          <summary>{text.frame.title}</summary>
          <FrameForm frame={frame} change={setFrame} robot={robot} length={length} problem={identify.problem} />
        </details>
        <details>
          <summary>{text.metadata.title}</summary>
          <div class="import-form">
            <MetadataForm typed={typed} change={setTyped} />
          </div>
        </details>
        {known && robots.length === 0 && joints !== null && <p class="soft">{words.noRobot(joints)}</p>}
      </section>

      <section class="card" aria-labelledby="step-preview">
        <h2 id="step-preview">
          <span class="step">3</span>
          {words.understood}
        </h2>
        {facts && <Preview facts={facts} />}
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
      </section>

      <Advanced
        form={form}
        facts={facts}
        joints={robots.find(({ id }) => id === robot)?.joints.map((joint) => joint.name) ?? []}
        problem={identify.problem}
      />
      <GoBar
        action={identify}
        ready={set !== null && robot !== "" && framed !== undefined && !busy && problem === null}
        why={busy ? null : (lackOf(answer, robot) ?? (framed === undefined ? text.frame.incomplete : null))}
      />
    </div>
  );
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
