/** Each joint of one robot over its runs, with intervals. */
import { useState } from "preact/hooks";
import { api, every } from "../api/client";
import type { JointResult, Method, Run } from "../api/types";
import { Figure } from "../charts/figure";
import { Trend } from "../charts/trend";
import { Choice, Empty, Name, Show, Title } from "../components/basics";
import { fixed } from "../lib/format";
import { shownStiffness } from "../lib/stiffness";
import { intervalIn, maybeInUnit, STIFFNESS_UNITS, type StiffnessUnit } from "../lib/units";
import { useLoad } from "../state/load";
import { storedRobot } from "../state/stored";
import { link } from "../state/router";
import { useSettings } from "../state/settings";
import { text } from "../i18n";

const words = text.trend;
const MOST = 40;
const METHODS: Method[] = ["partial_pose", "decoupled_partial_pose", "complete_pose"];

interface Timed {
  run: Run;
  set: string;
  encoders: string;
}

/** Runs of one method, oldest first: constrained ones, as those are what people use. */
async function load(robot: string, method: Method, signal: AbortSignal): Promise<Timed[]> {
  const [items, sets] = await Promise.all([
    every(api.runs, { robot_id: robot, method, elasticity: "joints", state: "succeeded" }, 200, signal),
    every(api.sets, { robot_id: robot }, 500, signal),
  ]);
  const chosen = items
    .filter((item) => item.positive)
    .slice(0, MOST)
    .reverse();
  const runs = await Promise.all(chosen.map((item) => api.run(item.id, signal)));
  const known = new Map(sets.map((set) => [set.id, set]));
  return runs.map((run) => {
    const set = known.get(run.request.measurement_set_id);
    return { run, set: set?.name ?? run.id, encoders: set?.encoders ?? "motor" };
  });
}

export function TrendView({ robot: id }: { robot: string }) {
  const [method, setMethod] = useState<Method>("partial_pose");
  const robot = useLoad(() => storedRobot(id), [id]);
  const runs = useLoad((signal) => load(id, method, signal), [id, method]);
  return (
    <Show of={robot} title={text.compare.trend}>
      {({ name, joints }) => (
        <>
          <Title kind={text.compare.trend} plain={words.title(name)}>
            <Name>{name}</Name>
          </Title>
          <p class="meta">
            <a href={link(["robots", id])}>{text.start.robot}</a>
          </p>
          <Choice
            label={words.method}
            value={method}
            change={setMethod}
            options={METHODS.map((value) => ({ value, label: text.methods[value] }))}
          />
          <Show of={runs}>
            {(timed) =>
              timed.length === 0 ? (
                <Empty title={words.none} hint={words.noneHint}>
                  <a class="button primary" href={link([], { robot: id })}>
                    {text.app.measure}
                  </a>
                </Empty>
              ) : (
                <>
                  {timed.length === 1 && <p class="note">{words.one}</p>}
                  <div class="multiples">
                    {joints.map((joint) => (
                      <JointTrend name={joint.name} timed={timed} />
                    ))}
                  </div>
                </>
              )
            }
          </Show>
        </>
      )}
    </Show>
  );
}

function JointTrend({ name, timed }: { name: string; timed: Timed[] }) {
  const { unit } = useSettings();
  const { label, column } = STIFFNESS_UNITS[unit];
  const found = timed.flatMap(({ run, set, encoders }) => {
    const joint = run.result?.joints.find((one) => one.name === name);
    return joint ? [{ run, set, encoders, joint }] : [];
  });
  const points = found.map(({ run, set, encoders, joint }) => ({
    time: Date.parse(run.provenance.created_at),
    value: maybeInUnit(joint.stiffness, unit),
    low: intervalIn(joint.stiffness_interval, unit)[0],
    high: joint.stiffness_interval ? intervalIn(joint.stiffness_interval, unit)[1] : maybeInUnit(joint.stiffness, unit),
    mark: encoders === "secondary" ? "method-0" : "method-1",
    title: `${set}\n${shown(joint, unit)} ${label}`,
    open: link(["runs", run.id]),
  }));
  const kinds = new Set(found.map((one) => one.encoders));
  return (
    <Figure
      title={name}
      note={changeOf(found)}
      legend={
        kinds.size > 1
          ? [
              { label: text.files.encoders.motor, mark: "method-1" },
              { label: text.files.encoders.secondary, mark: "method-0" },
            ]
          : []
      }
      table={{
        columns: [
          { title: words.run },
          { title: text.runs.set },
          { title: words.encoders },
          { title: text.runs.when },
          { title: text.run.value, unit: column },
          { title: text.run.low, unit: column },
          { title: text.run.high, unit: column },
        ],
        rows: found.map(({ run, set, encoders, joint }) => [
          run.id.slice(0, 8),
          set,
          encoders,
          run.provenance.created_at,
          maybeInUnit(joint.stiffness, unit),
          ...intervalIn(joint.stiffness_interval, unit),
        ]),
      }}
    >
      {(width) =>
        points.some((p) => p.value !== null || p.low !== null) ? (
          <Trend points={points} width={width} label={words.joint(name)} unit={label} />
        ) : (
          <p class="soft">{text.verdicts.unobservable}</p>
        )
      }
    </Figure>
  );
}

const shown = (joint: JointResult, unit: StiffnessUnit): string =>
  shownStiffness(joint, unit).value ?? text.run.noValue;

/** First to last run with the same encoders: by how much, and whether the intervals allow that nothing happened. */
function changeOf(found: { joint: JointResult; encoders: string }[]): string {
  const same = found.filter((one) => one.encoders === found.at(-1)?.encoders);
  const known = same
    .map((one) => one.joint)
    .filter((joint) => joint.stiffness !== null && joint.stiffness > 0 && joint.stiffness_interval);
  const [first, last] = [known[0], known.at(-1)];
  if (!first?.stiffness || !last?.stiffness || first === last) return "";
  const change = last.stiffness / first.stiffness - 1;
  const [a, b] = [first.stiffness_interval, last.stiffness_interval];
  const apart = a && b && (b[0] > (a[1] ?? Infinity) || a[0] > (b[1] ?? Infinity));
  return `${words.change(`${change > 0 ? "+" : ""}${fixed(change * 100, 1)}\u00a0%`)}, ${apart ? words.intervalsApart : words.intervalsOverlap}`;
}
