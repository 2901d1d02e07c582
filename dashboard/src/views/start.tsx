/** The flow: a file (or a stored set), its robot, a method, go. Three taps from file to result. */
import { useEffect, useMemo, useState } from "preact/hooks";
import { api, problemOf } from "../api/client";
import type { MeasurementSet, Problem, RobotSource } from "../api/types";
import { Arm } from "../components/arm";
import { Busy, Empty, ProblemNote, Prose, Select, Title, Warnings } from "../components/basics";
import { DropZone } from "../components/drop";
import { Preview } from "../components/preview";
import { type Campaign, factsOf, understand } from "../lib/campaign";
import { elsewhere } from "../lib/faults";
import { contentKey, freshKey } from "../lib/hash";
import { NOISE_AS_READ, statesNoise } from "../lib/noise";
import { initialOptions, type Options, requestOf } from "../lib/run_options";
import { formUnit } from "../lib/units";
import { useAction } from "../state/action";
import { handOver } from "../state/handed";
import { useLoad, valueOf } from "../state/load";
import { namesChanged, useNames } from "../state/names";
import { go, link } from "../state/router";
import { useSettings } from "../state/settings";
import { storedSet } from "../state/stored";
import { type FileFault, text } from "../i18n";
import { MethodForm } from "./method_form";
import { MoreSettings, SETTINGS_FIELDS } from "./more_settings";
import { NoiseForm } from "./noise_form";
import { RunList } from "./run_list";
import { withNoise } from "./variants";

const MAX_BYTES = 8 * 1024 * 1024;
const FROM_FILE = "file";
const TABLE = /\.(csv|tsv|txt|xls[bmx]?|ods)$/i;

type Opened = { name: string; campaign: Campaign } | { name: string; fault: FileFault };

export function StartView({ query }: { query: URLSearchParams }) {
  const names = useNames();
  const known = valueOf(names);
  const [opened, setOpened] = useState<Opened | null>(null);
  const [robot, setRobot] = useState(query.get("robot") ?? "");
  const [storedId, setStoredId] = useState(query.get("set") ?? "");
  const [options, setOptions] = useState<Options>(initialOptions);
  const [noise, setNoise] = useState(NOISE_AS_READ);
  const { factor } = formUnit(useSettings().unit);
  const campaign = opened && "campaign" in opened ? opened.campaign : null;

  const take = async (file: File) => {
    const fault = file.size > MAX_BYTES ? "too_large" : null;
    const understood = fault ?? understand(await file.text());
    if (understood === "sweeps") {
      handOver(file);
      return go("#/geometries");
    }
    const read: Campaign | FileFault = understood === "not_json" && TABLE.test(file.name) ? "table" : understood;
    setStoredId("");
    setOpened(typeof read === "string" ? { name: file.name, fault: read } : { name: file.name, campaign: read });
    if (typeof read === "string") return;
    setRobot((chosen) => (read.robot ? FROM_FILE : (read.robotId ?? (chosen === FROM_FILE ? "" : chosen))));
    setOptions((before) => ({ ...before, ...(read.run?.method ? { method: read.run.method } : {}) }));
  };
  const onlyRobot = known?.robots.length === 1 ? known.robots[0]?.id : undefined;
  const chosenRobot = robot || (campaign && !campaign.robot ? (onlyRobot ?? "") : robot);

  const stored = useStored(campaign, chosenRobot, storedId);
  const set = stored.set;
  const facts = set ? factsOf(set as never) : (campaign?.facts ?? null);
  const source = useMemo<RobotSource | null>(() => {
    if (campaign?.robot && chosenRobot === FROM_FILE) return { robot: campaign.robot };
    const id = storedId ? set?.robot_id : chosenRobot;
    return id && id !== FROM_FILE ? { robot_id: id } : null;
  }, [campaign, chosenRobot, storedId, set?.robot_id]);
  const identify = useAction(async () => {
    if (!set) return;
    const read = statesNoise(noise) ? await withNoise(set, noise) : set;
    const run = await api.addRun(requestOf(read.id, options, 1 / factor), freshKey("run"));
    go(link(["runs", run.id]));
  });

  return (
    <>
      <Title plain={text.app.measure}>{text.start.title}</Title>
      <div class="flow">
        <section class="card" aria-labelledby="step-file">
          <h2 id="step-file">
            <span class="step">1</span>
            {text.files.title}
          </h2>
          <DropZone
            title={text.files.drop}
            hint={text.files.dropHint}
            accept=".json,application/json"
            compact={opened !== null || storedId !== ""}
            button={opened || storedId ? text.files.another : text.files.choose}
            take={(file) => void take(file)}
          />
          {opened === null && (
            <p class="soft">
              <Prose text={text.files.imported} />
            </p>
          )}
          {known && known.sets.length > 0 && opened === null && (
            <Select
              label={text.files.stored}
              value={storedId}
              change={setStoredId}
              options={[
                { value: "", label: text.files.storedNone },
                ...known.sets.map((s) => ({ value: s.id, label: `${s.name} (${known.robot(s.robot_id)})` })),
              ]}
            />
          )}
          {opened && "fault" in opened && <Refused name={opened.name} fault={opened.fault} />}
          {facts && (
            <>
              <h3 class="file">
                <bdi>{facts.name ?? (opened ? opened.name : "")}</bdi>
              </h3>
              <Preview facts={facts} />
            </>
          )}
          {stored.busy && <Busy label={text.files.checking} />}
          {stored.problem && <ProblemNote problem={stored.problem} />}
          {set && <Findings set={set} />}
          {set && campaign && <p class="soft">{text.files.storedOnce}</p>}
        </section>

        <section class="card" aria-labelledby="step-robot">
          <h2 id="step-robot">
            <span class="step">2</span>
            {text.start.robot}
          </h2>
          {!storedId && (
            <div class="row">
              <Select
                label={text.start.robot}
                value={chosenRobot}
                change={setRobot}
                {...(campaign && !chosenRobot ? { hint: text.start.needRobot } : {})}
                options={[
                  { value: "", label: text.start.pick },
                  ...(campaign?.robot
                    ? [{ value: FROM_FILE, label: text.start.fromFile(String(campaign.robot.name ?? "")) }]
                    : []),
                  ...(known?.robots ?? []).map((r) => ({ value: r.id, label: r.name })),
                ]}
              />
              <a class="button" href="#/robots/new">
                {text.start.addRobot}
              </a>
            </div>
          )}
          {source ? (
            <Arm source={source} start={facts?.firstJoints ?? null} />
          ) : (
            <p class="stage blank">{text.start.armHere}</p>
          )}
        </section>

        <section class="card wide" aria-labelledby="step-method">
          <h2 id="step-method">
            <span class="step">3</span>
            {text.start.method}
          </h2>
          <MethodForm options={options} change={setOptions} facts={facts} problem={identify.problem} />
          <MoreSettings
            options={options}
            change={(part) => setOptions((before) => ({ ...before, ...part }))}
            joints={
              known?.robots.find(({ id }) => id === (set?.robot_id ?? chosenRobot))?.joints.map((j) => j.name) ?? []
            }
            problem={identify.problem}
          >
            <NoiseForm noise={noise} change={setNoise} problem={identify.problem} />
          </MoreSettings>
        </section>
        <div class={set ? "gobar wide ready" : "gobar wide"}>
          {identify.problem && <ProblemNote problem={elsewhere(identify.problem, SETTINGS_FIELDS)} />}
          <div class="go">
            <button type="button" class="button primary big" disabled={!set || identify.busy} onClick={identify.run}>
              {identify.busy ? text.start.going : text.start.go}
            </button>
            {!set && !stored.busy && (
              <span class="soft">{campaign && !chosenRobot ? text.start.robotFirst : text.start.notReady}</span>
            )}
          </div>
        </div>
      </div>
      <section aria-labelledby="recent">
        <h2 id="recent">{text.start.recent}</h2>
        <Recent />
      </section>
    </>
  );
}

function Recent() {
  const recent = useLoad((signal) => api.runs({ limit: 5 }, signal), []);
  const names = valueOf(useNames());
  if (recent.state === "loading") return <Busy />;
  if (recent.state === "failed") return <ProblemNote problem={recent.problem} retry={recent.reload} />;
  if (recent.value.items.length === 0) return <Empty title={text.runs.none} hint={text.start.recentNone} />;
  return <RunList runs={recent.value.items} names={names} />;
}

function Refused({ name, fault }: { name: string; fault: FileFault }) {
  const [title, remedy] = text.files.faults[fault];
  return (
    <div class="note bad" role="alert">
      <h3>{title}</h3>
      <p>
        <bdi>{name}</bdi>
      </p>
      <p>
        <b>{text.errors.remedy}:</b> {remedy}
      </p>
    </div>
  );
}

function Findings({ set }: { set: MeasurementSet }) {
  if (set.warnings.length === 0) return <p class="note good">{text.files.clean}</p>;
  return (
    <>
      <h3>{text.files.findings(set.warnings.length)}</h3>
      <Warnings warnings={set.warnings} />
    </>
  );
}

interface Stored {
  set: MeasurementSet | null;
  busy: boolean;
  problem: Problem | null;
}

/** The file as the service has stored and checked it, or the stored set that was chosen. */
function useStored(campaign: Campaign | null, robot: string, setId: string): Stored {
  const [stored, put] = useState<Stored>({ set: null, busy: false, problem: null });
  useEffect(() => {
    const ready = setId !== "" || (campaign !== null && robot !== "");
    put({ set: null, busy: ready, problem: null });
    if (!ready) return undefined;
    let gone = false;
    const answer = setId ? storedSet(setId) : store(campaign as Campaign, robot);
    answer.then(
      (set) => gone || put({ set, busy: false, problem: null }),
      (error: unknown) => gone || put({ set: null, busy: false, problem: problemOf(error) }),
    );
    return () => {
      gone = true;
    };
  }, [campaign, robot, setId]);
  return stored;
}

async function store(campaign: Campaign, robot: string): Promise<MeasurementSet> {
  const robotId =
    robot === FROM_FILE && campaign.robot
      ? (await api.addRobot(campaign.robot, contentKey("robot", campaign.robot))).id
      : robot;
  const document = { ...campaign.set, robot_id: robotId };
  const set = await api.addSet(document, contentKey("set", document));
  namesChanged();
  return set;
}
