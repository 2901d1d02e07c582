/** The form of a process: path, force or cut, turns about the spindle, and a box for the workpiece. */
import { api } from "../../api/calls";
import type { Robot } from "../../api/types";
import { queries } from "../../api/queries";
import { ActionButton, Choice, NameLink, Title, Toggle } from "../../components/basics";
import { RequestFields, TextField } from "../../components/fields";
import { SchemaFields, type Terms, useDescribed } from "../../components/schema_form";
import { BoxView } from "../../scene/box_view";
import { type Fields, freshKey, stated } from "../../lib/json";
import { listIn } from "../../lib/schema";
import { asking, link, useAction } from "../../state/action";
import { remember } from "../../state/kept";
import { useQuery } from "../../state/query";
import { useDraft } from "../../state/session";
import { text } from "../../words";
import { processWords as words } from "./words";
import { firstStand, type RunContext } from "../../state/run_context";
import { JobList } from "../runs/view";
import { FrameField, LAST_FORCE, LastForce, lackOf, ProgramFiles, Standing, useFiles } from "../use/forms";
import { settingWords } from "../readings/words";
import { programWords } from "../use/words";

const { deg, mm, newton } = text.units;
const UNITS = { length: "mm", angle: "deg", force: "N" };
const OF_PROCESS: Terms = {
  labels: words.labels,
  units: { start: [`${deg}, ${mm}`, 1], place: [mm, 1], feed: [`${mm}/s`, 1] },
  choices: {
    accuracy_option: programWords.accuracies,
    axes: programWords.axesOf,
    branches: words.branches,
    objective: words.objectives,
  },
};
const OF_LOAD: Terms = { labels: programWords.labels, within: "load.", units: { force: [newton, 1] } };
const OF_CUT: Terms = {
  labels: words.cutLabels,
  within: "cut.",
  units: { feed: [`${mm}/s`, 1e-3], speed: ["1/s", 1] },
};

/** Where the force comes from. */
type Source = keyof typeof words.sources;
type Turn = keyof typeof words.turns;

/** What the form holds: fields of the request, and which of them are meant. */
interface Asked extends Fields {
  source?: Source;
  turning?: Turn;
  placing?: boolean;
  /** Least and greatest turn, as typed. */
  range?: string;
}

const START: Asked = { source: "load", turning: "free", axes: "feed", grid: [4, 4, 3] };

/** The request of what was filled in: only the source of the force and the turn that are chosen. */
export function requestOf({ source, turning, placing, range, ...asked }: Asked, loads: string | undefined): Fields {
  const { load, cut, place, grid, place_turns: turns, ...others } = asked;
  const limits = listIn(range ?? "") ?? range; // what is not understood is for the service to name
  return stated({
    ...others,
    ...(source === "cut" ? { cut } : source === "table" ? { loads: loads ?? "" } : { load }),
    turn: turning === "range" ? limits : turning,
    ...(placing ? { place, grid, place_turns: turns } : {}),
  }) as Fields;
}

export const ProcessForm = ({ context }: { context: RunContext }) => (
  <AskProcess of={{ run_id: context.run.id }} robot={context.robot} joints={firstStand(context)} />
);

/** The form for a robot that was not measured, by the prior of its stiffness, and what was made with it before. */
export function ProcessesView({ query }: { query: URLSearchParams }) {
  const robot = query.get("robot") ?? "";
  const { data } = useQuery({ ...queries.robot(robot), enabled: robot !== "" });
  return (
    <>
      <Title kind={text.start.robot} plain={data?.name ?? words.kind}>
        {data ? <NameLink to={["robots", robot]}>{data.name}</NameLink> : words.kind}
      </Title>
      {robot && <p class="note">{words.byPrior}</p>}
      {data && <AskProcess of={{ robot_id: robot }} robot={data} joints={firstStand({ robot: data })} />}
      <JobList collection="processes" about={robot ? { robot_id: robot } : {}} />
    </>
  );
}

interface AskProcessProps {
  of: { run_id: string } | { robot_id: string };
  robot: Robot;
  /** Where the arm is drawn [rad, m]. */
  joints: number[];
}

/** The form, for the model of a run or the prior of a robot. */
function AskProcess({ of, robot, joints }: AskProcessProps) {
  const files = useFiles();
  const tables = useFiles();
  const [asked, change] = useDraft<Asked>(`processes/${Object.values(of).join()}`, START);
  const { source = "load", turning = "free", placing = false } = asked;
  const force = (asked["load"] as Fields | undefined)?.["force"];
  const make = useAction(async () => {
    const [table] = tables.files.slice(-1);
    const request = { ...of, units: UNITS, ...requestOf(asked, table?.name) };
    const sent = source === "table" && table ? [...files.files, table] : files.files;
    const made = await asking((accepted) => api.processes.add(sent, { ...request, ...accepted }, freshKey("process")));
    if (source === "load") remember(LAST_FORCE, force);
    return link(["processes", made.id]);
  });
  const fields = (show: readonly string[]) => (
    <SchemaFields of="ProcessRequest" show={show} value={asked} change={change} terms={OF_PROCESS} />
  );
  const given = {
    load: force,
    cut: asked["cut"],
    table: tables.files.length > 0,
  }[source];
  const known = useDescribed();
  const drawn = source === "load" && (asked["axes"] ?? "robot") === "robot" ? force : null;
  return (
    <div class="flow">
      <RequestFields action={make} look="card form" known={known}>
        <h2>{words.form}</h2>
        <p>{words.formNote}</p>
        <ProgramFiles of={files} title={words.drop} hint={words.dropHint} />
        {fields(["accuracy_option", "start"])}
        <div class="fields">
          <FrameField of={asked} name="tools" change={change} />
          <FrameField of={asked} name="bases" change={change} />
        </div>
        <h3>{words.forces}</h3>
        <Choice
          label={words.source}
          value={source}
          change={(to: Source) => change({ source: to })}
          options={words.sources}
        />
        {source === "load" && (
          <>
            <SchemaFields
              of="ProcessLoad"
              show={["force"]}
              value={(asked["load"] as Fields | undefined) ?? {}}
              change={(load) => change({ load })}
              terms={OF_LOAD}
            />
            <LastForce force={force} use={(last) => change({ load: { force: last } })} />
          </>
        )}
        {source === "cut" && (
          <SchemaFields
            of="Cut"
            show={["material", "diameter", "teeth", "speed", "feed", "depth", "width", "direction"]}
            value={(asked["cut"] as Fields | undefined) ?? {}}
            change={(cut) => change({ cut })}
            terms={OF_CUT}
          />
        )}
        {source === "table" && <ProgramFiles of={tables} title={words.dropTable} hint={words.dropTableHint} />}
        {fields(source === "cut" ? ["spindle"] : ["axes", "spindle", "feed"])}
        <h3>{words.turnTitle}</h3>
        <Choice
          label={words.turn}
          value={turning}
          change={(to: Turn) => change({ turning: to })}
          options={words.turns}
        />
        {turning === "range" && (
          <TextField
            label={words.range}
            unit={deg}
            path="turn"
            value={asked.range ?? ""}
            placeholder="-30, 30"
            change={(range) => change({ range })}
          />
        )}
        <Toggle label={words.placing} checked={placing} change={(on) => change({ placing: on })} />
        {placing && (
          <BoxView
            robot={robot.id}
            joints={joints}
            value={asked["place"]}
            unit={1e-3}
            change={(place) => change({ place })}
          >
            {fields(["place", "grid", "place_turns"])}
          </BoxView>
        )}
        <details>
          <summary>{settingWords.title}</summary>
          <div class="card form">
            {fields(["branches", "rate", "clearance", "objective", "turns", "force_uncertainty", "correct"])}
          </div>
        </details>
        <ActionButton
          look="primary"
          action={make}
          lacking={lackOf(asked, {
            program: files.files.length > 0,
            accuracy_option: asked["accuracy_option"],
            force: given,
          })}
        >
          {words.make}
        </ActionButton>
      </RequestFields>
      {!placing && (
        <section class="card sticky">
          <Standing robot={robot.id} joints={joints} force={drawn} />
        </section>
      )}
    </div>
  );
}
