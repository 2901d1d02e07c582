/** Robots of the same kinematics side by side: the latest run of each robot and serial number. */
import { api, every } from "../api/client";
import type { MeasurementSetSummary, Robot, Run, RunSummary } from "../api/types";
import { NameLink, LinkButton, Name, When } from "../components/basics";
import { Scroll } from "../components/table";
import { shownStiffness } from "../lib/stiffness";
import { STIFFNESS_UNITS } from "../lib/units";
import { useLoad, valueOf } from "../state/load";
import { link } from "../state/router";
import { useSettings } from "../state/settings";
import { text } from "../i18n";
import { MOST_RUNS } from "./side_by_side";

const MOST = 8;

interface Twin {
  robot: string;
  name: string;
  serial: string | null;
  encoders: MeasurementSetSummary["encoders"] | null;
  at: string;
  run: Run;
}

type Measured = Pick<MeasurementSetSummary, "serial_number" | "measured_at">;

/** The newest run of each robot and serial number, the newest first; runs that vary another do not count. */
export function newestOf(runs: RunSummary[], sets: ReadonlyMap<string, Measured>): RunSummary[] {
  const time = (run: RunSummary) => Date.parse(sets.get(run.measurement_set_id)?.measured_at ?? run.created_at);
  const seen = new Set<string>();
  return runs
    .filter((run) => run.variant_of === null)
    .sort((a, b) => time(b) - time(a))
    .filter((run) => {
      const key = `${run.robot_id}\n${sets.get(run.measurement_set_id)?.serial_number ?? ""}`;
      return !seen.has(key) && seen.add(key);
    });
}

async function twinsOf(robot: Robot, signal: AbortSignal): Promise<Twin[]> {
  const { items: robots } = await api.robots.list({ content_hash: robot.content_hash, limit: MOST }, signal);
  const each = <Item,>(list: (of: { robot_id: string }) => Promise<Item[]>) =>
    Promise.all(robots.map(({ id }) => list({ robot_id: id }))).then((lists) => lists.flat());
  const [sets, runs] = await Promise.all([
    each((of) => every(api.sets.list, of, 100, signal)),
    each((of) => every(api.runs.list, { ...of, state: "succeeded" }, 100, signal)),
  ]);
  const known = new Map(sets.map((set) => [set.id, set]));
  const names = new Map(robots.map(({ id, name }) => [id, name]));
  const newest = newestOf(runs, known).slice(0, MOST);
  return Promise.all(
    newest.map(async (summary) => ({
      robot: summary.robot_id,
      name: names.get(summary.robot_id) ?? summary.robot_id,
      serial: known.get(summary.measurement_set_id)?.serial_number ?? null,
      encoders: known.get(summary.measurement_set_id)?.encoders ?? null,
      at: known.get(summary.measurement_set_id)?.measured_at ?? summary.created_at,
      run: await api.runs.one(summary.id, signal),
    })),
  );
}

/** Nothing, while there is only one robot of the kind. */
export function Twins({ robot }: { robot: Robot }) {
  const { unit } = useSettings();
  const twins = valueOf(useLoad((signal) => twinsOf(robot, signal), [robot.id, robot.content_hash])) ?? [];
  if (twins.length < 2) return null;
  const words = text.robots;
  const ids = twins.slice(0, MOST_RUNS).map(({ run }) => run.id);
  return (
    <section class="card">
      <h2>{words.twins}</h2>
      <p class="soft">{words.twinsHint(STIFFNESS_UNITS[unit].label)}</p>
      <Scroll label={words.twins}>
        <table>
          <thead>
            <tr>
              <th scope="col">{text.start.robot}</th>
              <th scope="col">{words.serial}</th>
              <th scope="col">{words.latest}</th>
              {robot.joints.map(({ name }) => (
                <th scope="col" class="number">
                  <Name>{name}</Name>
                </th>
              ))}
            </tr>
          </thead>
          <tbody>
            {twins.map(({ robot: id, name, serial, encoders, at, run }) => (
              <tr>
                <th scope="row" class="robot-name">
                  <NameLink to={["robots", id]}>{name}</NameLink>
                </th>
                <td>{serial === null ? "–" : <Name>{serial}</Name>}</td>
                <td>
                  <a href={link(["runs", run.id])}>
                    <When time={at} />
                  </a>
                  {encoders && <small class="soft"> {text.files.encoders[encoders]}</small>}
                </td>
                {robot.joints.map((joint) => {
                  const found = run.result?.joints.find((each) => each.name === joint.name);
                  const shown = found && shownStiffness(found, unit);
                  return (
                    <td class="number">
                      {shown?.value ?? shown?.limit ?? "–"}
                      {shown?.uncertainty && <span class="soft"> ±&nbsp;{shown.uncertainty}</span>}
                    </td>
                  );
                })}
              </tr>
            ))}
          </tbody>
        </table>
      </Scroll>
      <LinkButton href={link(["compare", "runs"], { ids: ids.join() })}>{words.beside}</LinkButton>
    </section>
  );
}
