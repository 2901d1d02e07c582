/** Robots of the same kinematics side by side: the latest run of each robot and serial number. */
import { api, every } from "../api/client";
import type { MeasurementSetSummary, Robot, RunSummary } from "../api/types";
import { dayText, LinkButton } from "../components/basics";
import { useLoad, valueOf } from "../state/load";
import { link } from "../state/router";
import { text } from "../i18n";
import { later } from "../i18n/later";
import { MOST_RUNS } from "./runs";
import { type RunColumn, RunsTable } from "./runs_table";

const MOST = 8;

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

async function twinsOf(robot: Robot, signal: AbortSignal): Promise<RunColumn[]> {
  const { items: robots } = await api.robots.list({ content_hash: robot.content_hash, limit: MOST }, signal);
  const each = <Item,>(list: (of: { robot_id: string }) => Promise<Item[]>) =>
    Promise.all(robots.map(({ id }) => list({ robot_id: id }))).then((lists) => lists.flat());
  const [sets, runs] = await Promise.all([
    each((of) => every(api.sets.list, of, 100, signal)),
    each((of) => every(api.runs.list, { ...of, state: "succeeded" }, 100, signal)),
  ]);
  const known = new Map(sets.map((set) => [set.id, set]));
  const names = new Map(robots.map(({ id, name }) => [id, name]));
  return Promise.all(
    newestOf(runs, known)
      .slice(0, MOST)
      .map(async ({ id, robot_id: of, measurement_set_id: setId, created_at: created }) => {
        const set = known.get(setId);
        const encoders = set && text.files.encoders[set.encoders];
        const note = [set?.serial_number, dayText(set?.measured_at ?? created), encoders].filter(Boolean).join(", ");
        return { run: await api.runs.one(id, signal), name: names.get(of) ?? of, note };
      }),
  );
}

/** Nothing, while there is only one robot of the kind. */
export function Twins({ robot }: { robot: Robot }) {
  const twins = valueOf(useLoad((signal) => twinsOf(robot, signal), [robot.id, robot.content_hash])) ?? [];
  if (twins.length < 2) return null;
  const words = later.robots;
  const ids = twins.slice(0, MOST_RUNS).map(({ run }) => run.id);
  return (
    <section class="card">
      <h2>{words.twins}</h2>
      <RunsTable columns={twins} label={words.twins} />
      <LinkButton href={link(["compare", "runs"], { ids: ids.join() })}>{words.beside}</LinkButton>
    </section>
  );
}
