/** The start: files, or a stored set, to their result in three taps. */
import { useEffect, useState } from "preact/hooks";
import { api } from "../../api/calls";
import { queries } from "../../api/queries";
import type { MeasurementSet } from "../../api/types";
import { Busy, LinkButton, ProblemNote, Button, Empty, Show, Title, lazy } from "../../components/basics";
import { RobotSelect, SetSelect } from "../../components/choosers";
import { RequestFields } from "../../components/fields";
import { Findings, Preview } from "../../components/findings";
import { type Campaign, factsOf, statesNoise } from "../../lib/campaign";
import { contentKey, freshKey, type Fields as Document } from "../../lib/json";
import { useAction, link } from "../../state/action";
import { begunFiles, keepFiles } from "../readings/begun";
import { FROM_FILE, likelyRobot, ROBOTS, SETS, sourceOf } from "../../state/choices";
import { type Opened, open } from "../readings/opening";
import { isKnown, useQuery } from "../../state/query";
import { text } from "../../words";
import { FileDrop, GoBar, Refused, Step, Advanced, useRunForm } from "../readings/flow";
import { withNoise } from "../run/assumed";
import { Rows } from "../../components/list";
import { WorstArms } from "../wall/table";
import { OpenCampaigns, TrySimulated } from "../measure/open_campaigns";
import { latestRows } from "../runs/view";
import { measureWords } from "../measure/words";
import { importWords } from "../readings/words";
import { robotWords } from "../robots/words";
import { startWords } from "./words";

const Arm = lazy(async () => (await import("../../scene/view")).Arm);
const ImportFlow = lazy(async () => (await import("../readings/import")).ImportFlow);

interface FlowProps {
  opened: Opened | null;
  robot: string;
  /** A stored set that was chosen, else empty. */
  set: string;
  setSet: (set: string) => void;
  take: (...files: File[]) => void;
}

export function CampaignFlow({ opened, robot: asked, set: chosenSet, setSet, take }: FlowProps) {
  const { data: robots } = useQuery(queries.robots(ROBOTS));
  const { data: sets } = useQuery(queries.sets(SETS));
  const [choice, setChoice] = useState<{ of: Campaign | null; robot: string }>({ of: null, robot: asked });
  const form = useRunForm(opened?.kind === "campaign" ? opened.name : chosenSet);
  const campaign = opened?.kind === "campaign" ? opened.campaign : null;
  const storedId = opened ? "" : chosenSet;
  const { data: askedRobot } = useQuery({ ...queries.robot(asked), enabled: asked !== "" });
  const axes = campaign?.facts.firstJoints?.length ?? null;
  const canBeOf = (one: { joints: readonly unknown[] }) => axes === null || one.joints.length === axes;
  const isAsked = asked !== "" && (askedRobot === undefined || canBeOf(askedRobot));
  const ownRobot = campaign?.robot ? FROM_FILE : (campaign?.robotId ?? "");
  const before = choice.robot === FROM_FILE ? "" : choice.robot;
  const begun = isAsked ? asked : ownRobot || before;
  const robot = choice.of === campaign ? choice.robot : begun;
  const setRobot = (chosen: string) => setChoice({ of: campaign, robot: chosen });
  useEffect(() => {
    if (campaign?.run) form.setRun(campaign.run as Document);
  }, [campaign]);
  const likely = robots && campaign && !campaign.robot ? likelyRobot(robots, canBeOf) : "";
  const chosenRobot = robot || likely;

  const stored = useQuery({ ...queries.set(storedId), enabled: storedId !== "" });
  const [added, setAdded] = useState<{ of: Campaign; set: MeasurementSet } | null>(null);
  const set = campaign ? (added?.of === campaign ? added.set : null) : ((storedId ? stored.data : null) ?? null);
  const facts = set ? factsOf(set as never) : (campaign?.facts ?? null);
  const source = sourceOf(storedId ? set?.robot_id : chosenRobot, campaign?.robot);
  const identify = useAction(async () => {
    const known = set ?? (campaign && chosenRobot ? await store(campaign, chosenRobot) : null);
    if (!known) return;
    if (campaign && set === null && known.warnings.some(({ weight }) => weight === "do_not_use")) {
      return setAdded({ of: campaign, set: known }); // to be read before it is identified all the same
    }
    const read = statesNoise(form.noise) ? await withNoise(known, form.noise) : known;
    const run = await api.runs.add(form.request(read.id), freshKey("run"));
    return link(["runs", run.id]);
  });
  const ofId = set?.robot_id ?? (chosenRobot === FROM_FILE ? "" : chosenRobot);
  const { data: ofRobot } = useQuery({ ...queries.robot(ofId), enabled: ofId !== "" });
  const refused = opened?.kind === "fault" ? startWords.anotherFile : startWords.notReady;
  const lacking = campaign && !chosenRobot ? text.start.robotFirst : refused;

  return (
    <RequestFields action={identify} look="flow" known>
      <Step at={1} title={text.files.title}>
        <FileDrop again={opened !== null || storedId !== ""} take={take} />
        {opened?.kind === "mapping" && <p class="note good">{importWords.mappingFirst(opened.name)}</p>}
        {sets && sets.items.length > 0 && opened === null && (
          <SetSelect label={text.files.stored} value={storedId} change={setSet} none={text.files.storedNone} />
        )}
        {opened?.kind === "fault" && <Refused file={opened.name} why={text.files.faults[opened.fault]} />}
        {facts && (
          <>
            <h3 class="file">
              <bdi>{facts.name ?? (opened?.kind === "campaign" ? opened.name : "")}</bdi>
            </h3>
            <Preview facts={facts} />
          </>
        )}
        {storedId && !stored.data && !stored.problem && <Busy label={text.files.checking} />}
        {storedId && stored.problem && <ProblemNote problem={stored.problem} />}
        {set && <Findings warnings={set.warnings} />}
        {set && campaign && <p class="soft">{startWords.readFindings}</p>}
      </Step>

      {facts && (
        <>
          <Step at={2} title={text.start.robot}>
            {!storedId && (
              <div class="row">
                <RobotSelect
                  label={text.start.robot}
                  value={chosenRobot}
                  change={setRobot}
                  {...(campaign && !chosenRobot ? { help: startWords.needRobot } : {})}
                  none={text.start.pick}
                  ofFile={campaign?.robot}
                />
                <LinkButton href="#/robots/new">{robotWords.add}</LinkButton>
              </div>
            )}
            <Arm source={source} start={facts.firstJoints} />
          </Step>
          <Advanced form={form} joints={ofRobot?.joints.map((joint) => joint.name) ?? []} />
        </>
      )}
      {(opened !== null || storedId !== "") && (
        <GoBar
          action={identify}
          ready={campaign ? chosenRobot !== "" : set !== null}
          why={storedId && !stored.data && !stored.problem ? null : lacking}
        />
      )}
    </RequestFields>
  );
}

/** Store robot and readings of a file, as the last tap does. */
async function store(campaign: Campaign, robot: string): Promise<MeasurementSet> {
  const robotId =
    robot === FROM_FILE && campaign.robot
      ? (await api.robots.add(campaign.robot, contentKey("robot", campaign.robot))).id
      : robot;
  const document = { ...campaign.set, robot_id: robotId };
  const set = await api.sets.add(document, contentKey("set", document));
  return set;
}

export function StartView({ query }: { query: URLSearchParams }) {
  const begun = useQuery(begunFiles);
  const needed = [begun, useQuery(queries.robots(ROBOTS)), useQuery(queries.sets(SETS))];
  /** What was opened in this view; null until then. */
  const [chosen, setOpened] = useState<Opened | null>(null);
  const [set, setSet] = useState(query.get("set") ?? "");
  const opened = chosen ?? (set ? null : (begun.data?.opened ?? null));
  const [count, setCount] = useState(0);
  const take = async (...files: File[]) => {
    const read = await open(files, opened);
    keepFiles(read);
    setOpened(read);
    setCount((before) => before + 1);
  };
  const robot = query.get("robot") ?? "";
  const idle = opened === null && set === "";
  const taken = (...files: File[]) => void take(...files);
  return (
    <>
      <Title plain={text.app.measure}>{startWords.title}</Title>
      {!needed.every(isKnown) ? (
        <Busy />
      ) : (
        <div class={idle ? "start" : "start begun"}>
          <div>
            {opened?.kind === "tables" ? (
              <ImportFlow key={`${count} ${robot}`} opened={opened} robot={robot} take={taken} />
            ) : (
              <CampaignFlow key={robot} opened={opened} robot={robot} set={set} setSet={setSet} take={taken} />
            )}
            {idle && <OtherWays example={async () => take(await example())} />}
          </div>
          {opened?.kind !== "tables" && <GoOn />}
        </div>
      )}
    </>
  );
}

/** Ways to a result without a file. */
function OtherWays({ example }: { example: () => Promise<void> }) {
  return (
    <div class="ways">
      <section class="card">
        <h2>{startWords.liveWay}</h2>
        <p class="soft">{startWords.liveHint}</p>
        <LinkButton href={link(["measure"])}>{measureWords.title}</LinkButton>
      </section>
      <section class="card">
        <h2>{startWords.noReadings}</h2>
        <p class="soft">{startWords.exampleHint}</p>
        <div class="actions">
          <Button onClick={() => void example()}>{startWords.example}</Button>
          <TrySimulated />
        </div>
      </section>
    </div>
  );
}

/** A campaign to try the page with, of a robot that it brings along. */
async function example(): Promise<File> {
  const answer = await fetch(new URL("./example.json", import.meta.url));
  return new File([await answer.blob()], "example.json");
}

/** What was begun before: campaigns that are still measured, robots by their change, the latest runs. */
function GoOn() {
  return (
    <section class="go-on" aria-labelledby="go-on">
      <h2 id="go-on">{startWords.goOn}</h2>
      <OpenCampaigns as="h3" />
      <WorstArms most={ON_START} title={text.app.robots} />
      <Recent />
    </section>
  );
}

const SHOWN = 5;

/** Arms on the start, the worst: which robot changed, by how much; all are one tap away. */
const ON_START = 12;

function Recent() {
  const recent = useQuery(queries.runs({ limit: 50 }));
  return (
    <>
      <h3>{startWords.recent}</h3>
      <Show
        of={recent}
        instead={({ items }) => items.length === 0 && <Empty title={startWords.none} hint={startWords.recentNone} />}
      >
        {({ items }) => <Rows rows={latestRows(items).slice(0, SHOWN)} />}
      </Show>
    </>
  );
}
