/** Live campaigns that go on, and one that the page simulates: what the start shows of measuring. */
import { api } from "../../api/calls";
import { problemOf } from "../../api/problem";
import { queries } from "../../api/queries";
import { ActionButton, Busy } from "../../components/basics";
import { DeleteButton, Rows } from "../../components/list";
import { text } from "../../words";
import { freshKey } from "../../lib/json";
import * as live from "./live";
import { go, link, toast, useAction } from "../../state/action";
import { isKnown, send, useQuery } from "../../state/query";
import { measureWords } from "./words";
import { SI } from "../../lib/observation";

const words = measureWords;

/** Campaigns that are still measured. */
export const OPEN = { open: true, limit: 20 } as const;

/** Campaigns that are still measured, on this device or another. */
export function OpenCampaigns({ as: Heading }: { as: "h2" | "h3" }) {
  const listed = useQuery(queries.sets(OPEN));
  if (!isKnown(listed)) return <Busy />;
  const { data: open } = listed;
  if (!open || open.items.length === 0) return null;
  const failed = (error: unknown) => toast(problemOf(error).detail);
  const remove = (id: string, name: string) =>
    void send(() => api.openSets.delete(id)).then(() => {
      const restore = () => void send(() => api.openSets.restore(id)).catch(failed);
      toast(text.deletion.done(name), { label: text.runs.undo, run: restore });
    }, failed);
  return (
    <>
      <Heading>{words.goOn}</Heading>
      <Rows
        rows={open.items.map(({ id, name, observation_count: count }) => ({
          id,
          name,
          href: link(["measure", id]),
          how: words.opened(count),
          actions: <DeleteButton name={name} remove={() => remove(id, name)} />,
        }))}
      />
    </>
  );
}

/** An arm of springs that the page computes: a whole campaign without a robot. */
export function TrySimulated() {
  const begin = useAction(async () => {
    const known = await api.robots.list({ name: words.simulatedArm, limit: 1 });
    const robot =
      known.items[0] ??
      (await api.robots.add(
        { name: words.simulatedArm, model: { format: "catalogue", arm: live.SIMULATED_ARM } },
        freshKey("robot"),
      ));
    const truth = live.SIMULATED_STIFFNESSES.map((stiffness) => (stiffness / 1e6).toPrecision(3));
    const set = await api.openSets.add(
      {
        robot_id: robot.id,
        name: words.simulatedName,
        units: SI,
        encoders: "motor",
        instrument: live.SIMULATED,
        notes: words.simulatedNotes(truth.join(", ")),
        noise: { sigma: live.SIGMA, load_point: 1e-4, grounds: { load_point: "tracker" }, force: { scale: 1e-3 } },
        load_point: live.SIMULATED_LOAD_POINT,
        flange_targets: live.SIMULATED_TARGETS,
        open: { goal: { kind: "joints", relative: 0.1 }, load: { kind: "dead_weight", mass: live.SIMULATED_MASS } },
      },
      freshKey("live"),
    );
    go(link(["measure", set.id]));
  }, "live");
  return (
    <ActionButton action={begin} going={words.trying}>
      {words.try}
    </ActionButton>
  );
}
