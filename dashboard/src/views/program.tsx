/** A compensated program: the path over the robot by its deflection, before and after, the worst points, the files. */
import { useMemo, useState } from "preact/hooks";
import { api } from "../api/client";
import { goesOn } from "../api/events";
import type { Program, ProgramResult, Run } from "../api/types";
import { Busy, Choice, Facts, Name, ProblemNote, Show, State, Title, When } from "../components/basics";
import { Cancelled, Going } from "../components/going";
import { JobActions } from "../components/job_actions";
import { RampLegend, share } from "../components/slice";
import { DataTable } from "../components/table";
import { significant } from "../lib/format";
import { parsePoints, type PathPoint, thinned } from "../lib/program";
import { ARM_ALONE, type Show as Shown } from "../scene/show";
import { ArmView, roomOf } from "../scene/view";
import { useKinematics } from "../state/posture";
import { cached } from "../state/cache";
import { useLoad } from "../state/load";
import { link } from "../state/router";
import { storedSet } from "../state/stored";
import { text } from "../i18n";

const words = text.program;
const MOST_DRAWN = 3_000;
const WIDTH = 0.012; // of a point, in m

interface Loaded {
  program: Program;
  run: Run;
  robot: string;
  points: PathPoint[];
}

async function load(id: string, signal?: AbortSignal): Promise<Loaded> {
  const program = await api.program(id, signal);
  const run = await cached(`run/${program.request.run_id}`, () => api.run(program.request.run_id));
  const set = await storedSet(run.request.measurement_set_id);
  const points = program.result ? parsePoints(await api.programPoints(id)) : [];
  return { program, run, robot: set.robot_id, points };
}

export function ProgramView({ id }: { id: string }) {
  const loaded = useLoad((signal) => load(id, signal), [id]);
  return (
    <Show of={loaded} title={words.kind}>
      {(found) => (
        <>
          <Head loaded={found} />
          <Body loaded={found} ended={loaded.reload} />
        </>
      )}
    </Show>
  );
}

function Head({ loaded: { program, run } }: { loaded: Loaded }) {
  const name = program.request.files[0]?.name ?? words.kind;
  return (
    <div class="head">
      <Title kind={words.kind} plain={name}>
        <Name>{name}</Name>
      </Title>
      <p class="meta">
        {!program.result && !goesOn(program.state) && <State state={program.state} />}
        <a href={link(["runs", run.id])}>{text.run.kind}</a>
        <When time={program.provenance.created_at} />
      </p>
      <JobActions
        kind="program"
        job={program}
        name={name}
        remove={goesOn(program.state) ? null : () => api.deleteProgram(program.id)}
        restore={() => api.restoreProgram(program.id)}
        list={link(["runs", run.id])}
      >
        {program.result?.files.map((file) => (
          <a class="button primary" href={api.programFile(program.id, file.name)} download={file.name}>
            {words.download(file.name)}
          </a>
        ))}
        {program.result && (
          <a class="button" href={api.programTable(program.id)} download>
            {words.table}
          </a>
        )}
      </JobActions>
    </div>
  );
}

function Body({ loaded, ended }: { loaded: Loaded; ended: () => void }) {
  const { program } = loaded;
  if (goesOn(program.state))
    return <Going collection="programs" job={program} cancel={() => api.cancelProgram(program.id)} ended={ended} />;
  if (program.state === "cancelled") return <Cancelled progress={program.progress} />;
  if (program.error) return <ProblemNote problem={program.error} />;
  if (!program.result) return null;
  return (
    <>
      <Counts result={program.result} />
      <Scene loaded={loaded} />
      <h2>{words.worst}</h2>
      <Worst result={program.result} />
      {program.result.remarks.length > 0 && (
        <ul>
          {program.result.remarks.map((remark) => (
            <li>{remark}</li>
          ))}
        </ul>
      )}
    </>
  );
}

const micrometres = (value: number | undefined): string =>
  value === undefined ? "–" : `${significant(value * 1e6, 3)} ${text.units.micrometre}`;

function Counts({ result }: { result: ProgramResult }) {
  const left = Object.entries(result.left_alone) as [keyof typeof words.leftAlone, number][];
  return (
    <Facts
      facts={[
        { label: words.corrected, value: words.of(result.corrected, result.points) },
        { label: words.before, value: micrometres(result.deflection?.greatest) },
        { label: words.after, value: micrometres(result.residual?.greatest) },
        { label: words.rounding, value: micrometres(result.rounding?.greatest) },
        ...(result.capped > 0 ? [{ label: words.capped, value: String(result.capped) }] : []),
        ...left.map(([reason, count]) => ({ label: words.leftAlone[reason], value: String(count) })),
      ]}
    />
  );
}

function Scene({ loaded: { points, robot } }: { loaded: Loaded }) {
  const [when, setWhen] = useState<"before" | "after">("before");
  const [chosen, setChosen] = useState(0);
  const drawn = useMemo(() => thinned(points, MOST_DRAWN), [points]);
  const point = points[chosen];
  const { kinematics } = useKinematics(point ? { robot_id: robot } : null, point ? [point.joints] : []);
  const posture = kinematics?.postures[0];
  const greatest = useMemo(
    () => points.reduce((most, one) => (one.deflection > most ? one.deflection : most), 0),
    [points],
  );
  const show = useMemo<Shown | null>(() => {
    if (!posture) return null;
    const loadedOnes = drawn.filter((one) => Number.isFinite(one.deflection));
    return {
      ...ARM_ALONE,
      axes: false,
      posture,
      cloud: {
        places: loadedOnes.map((one) => one.place),
        shares: loadedOnes.map((one) => share(when === "before" ? one.deflection : one.residual, [0, greatest])),
        size: WIDTH,
      },
    };
  }, [posture, drawn, when, greatest]);
  const room = useMemo(
    () => [...(posture ? roomOf([posture]) : []), ...drawn.map((one) => one.place)],
    [posture, drawn],
  );
  if (!show || !point) return <Busy label={text.scene.loading} />;
  return (
    <section class="scene">
      <div class="view">
        <ArmView show={show} room={room} label={words.view} />
      </div>
      <div class="controls">
        <Choice
          label={words.colour}
          value={when}
          change={setWhen}
          options={[
            { value: "before", label: words.beforeShort },
            { value: "after", label: words.afterShort },
          ]}
        />
        <RampLegend scale={[0, greatest]} unit={text.units.mm} label={words.off} />
        <label class="field">
          <span>{words.point(point.number, point.line)}</span>
          <input
            type="range"
            min={0}
            max={points.length - 1}
            step={1}
            value={chosen}
            aria-label={words.choosePoint}
            onInput={(event) => setChosen(Number(event.currentTarget.value))}
          />
        </label>
      </div>
    </section>
  );
}

function Worst({ result }: { result: ProgramResult }) {
  const { mm } = text.units;
  const table = {
    columns: [
      { title: words.columns.number },
      { title: words.columns.name },
      { title: words.columns.line },
      { title: words.columns.deflection, unit: mm },
      { title: words.columns.low, unit: mm },
      { title: words.columns.high, unit: mm },
      { title: words.columns.lowModel, unit: mm },
      { title: words.columns.highModel, unit: mm },
      { title: words.columns.correction, unit: mm },
      { title: words.columns.residual, unit: mm },
    ],
    rows: result.worst.map((one) => [
      one.number,
      one.name,
      one.line,
      one.deflection * 1e3,
      one.interval ? one.interval[0] * 1e3 : null,
      one.interval ? one.interval[1] * 1e3 : null,
      one.interval_with_model_error ? one.interval_with_model_error[0] * 1e3 : null,
      one.interval_with_model_error ? one.interval_with_model_error[1] * 1e3 : null,
      one.correction * 1e3,
      one.residual * 1e3,
    ]),
  };
  return <DataTable table={table} caption={words.worst} />;
}
