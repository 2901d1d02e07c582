/** Each joint of one robot over its campaigns: charts against a baseline, alarms, and new baselines. */
import { useState } from "preact/hooks";
import { api } from "../api/client";
import type { Method, Robot, Trend as Found, TrendJoint } from "../api/types";
import { Figure, Legend } from "../charts/figure";
import { Trend } from "../charts/trend";
import { Badge, dayText, Empty, Head, LinkButton, Name, Show } from "../components/basics";
import { alike } from "../components/table";
import { Select } from "../components/fields";
import { Rows } from "../components/list";
import { pValue } from "../lib/format";
import { bandsOf, changeText, pointsOf, worstFirst } from "../lib/trend";
import { intervalIn, maybeInUnit, unitOf } from "../lib/units";
import { useLoad } from "../state/load";
import { go, link } from "../state/router";
import { useSettings } from "../state/settings";
import { storedRobot } from "../state/names";
import { text } from "../i18n";
import { later } from "../i18n/later";
import { Alarms, NewBaseline } from "./trend_notes";

const words = later.trend;
type Encoders = NonNullable<Found["selection"]>["encoders"];
const ENCODERS: Encoders[] = ["motor", "secondary"];
const METHODS: Method[] = ["partial_pose", "decoupled_partial_pose", "complete_pose"];

export function TrendView({ robot: id, serial }: { robot: string; serial: string | null }) {
  const [method, setMethod] = useState<Method | null>(null);
  const [encoders, setEncoders] = useState<Encoders | null>(null);
  const robot = useLoad(() => storedRobot(id), [id]);
  const asked = { method, encoders, serial_number: serial };
  const trend = useLoad((signal) => api.trend(id, asked, signal), [id, method, encoders, serial]);
  return (
    <Show of={robot} title={later.compare.trend}>
      {({ name }) => (
        <>
          <Head
            kind={later.compare.trend}
            plain={words.title(name)}
            title={<Name>{name}</Name>}
            about={
              <>
                <a href={link(["robots", id])}>{text.start.robot}</a>
                <a href={link(["fleet"])}>{text.fleet.title}</a>
              </>
            }
          />
          <Show of={trend}>
            {(found) => (
              <>
                <div class="filters compact">
                  <Select
                    label={text.run.method}
                    value={method ?? found.selection?.method ?? "partial_pose"}
                    change={(chosen) => setMethod(chosen as Method)}
                    options={METHODS.map((value) => ({ value, label: text.methods[value] }))}
                  />
                  <Select
                    label={words.encoders}
                    value={encoders ?? found.selection?.encoders ?? "motor"}
                    change={(chosen) => setEncoders(chosen as Encoders)}
                    options={ENCODERS.map((value) => ({ value, label: text.files.encoders[value] }))}
                  />
                  {serialsOf(found).length > 1 && (
                    <Select
                      label={words.serial}
                      value={found.selection?.serial_number ?? ""}
                      change={(chosen) => go(link(["compare", "trend", id], { serial: chosen }))}
                      options={serialsOf(found)}
                    />
                  )}
                </div>
                <Charts robot={id} trend={found} reload={trend.reload} />
              </>
            )}
          </Show>
        </>
      )}
    </Show>
  );
}

/** The serial numbers of the robot's sets, and that the chart shown is of sets without one. */
const serialsOf = ({ selection, serial_numbers: serials }: Found) => [
  ...(selection?.serial_number ? [] : [{ value: "", label: text.fleet.noSerial }]),
  ...serials.map((value) => ({ value, label: value })),
];

function Charts({ robot, trend, reload }: { robot: Robot["id"]; trend: Found; reload: () => void }) {
  if (trend.campaigns.length === 0) {
    return (
      <>
        <Empty title={words.none} hint={words.noneHint}>
          <LinkButton look="primary" href={link([], { robot })}>
            {text.app.measure}
          </LinkButton>
        </Empty>
        <LeftOut trend={trend} />
      </>
    );
  }
  return (
    <>
      {trend.note !== null && <p class="note">{words.notYet(trend.note)}</p>}
      <Alarms trend={trend} reload={reload} />
      <p class="hint">{words.rate(trend.false_alarms)}</p>
      <Legend
        items={[
          { label: words.campaign, mark: "method-1" },
          { label: words.inBaseline, mark: "free" },
          { label: words.smoothed, mark: "smoothed" },
          { label: words.limits, mark: "limit" },
          { label: words.band, mark: "band" },
          { label: words.alarm, mark: "alarm" },
        ]}
      />
      <div class="multiples">
        {worstFirst(trend.joints).map((joint) => (
          <JointTrend key={joint.name} joint={joint} trend={trend} />
        ))}
      </div>
      <details open={trend.campaigns.some(({ assessment }) => assessment.verdict !== "use")}>
        <summary>{words.takes(trend.campaigns.length)}</summary>
        <Rows
          rows={trend.campaigns.map(({ run_id: id, name, at, assessment }) => ({
            id,
            href: link(["runs", id]),
            name,
            what: <Name>{name}</Name>,
            at,
            standing: <Badge verdict={assessment.verdict} />,
          }))}
        />
      </details>
      <NewBaseline trend={trend} reload={reload} />
      <LeftOut trend={trend} />
    </>
  );
}

function JointTrend({ joint, trend }: { joint: TrendJoint; trend: Found }) {
  const { unit } = useSettings();
  const { label, column } = unitOf(unit, joint.kind);
  const points = pointsOf(trend, joint, unit, sayer(joint, trend), (run) => link(["runs", run]));
  return (
    <Figure
      title={joint.name}
      note={noteOf(joint)}
      table={{
        columns: [
          text.sets.kind,
          text.runs.when,
          words.role,
          ...alike([text.run.value, text.run.low, text.run.high, words.smoothed, words.lower, words.upper], column),
          words.changed,
          text.run.verdict,
        ],
        rows: trend.campaigns.map(({ name, at, assessment }, i) => {
          const point = joint.points[i];
          return [
            name,
            at.slice(0, 16).replace("T", " "),
            point ? words.roles[point.role] : "",
            maybeInUnit(point?.stiffness, unit, joint.kind),
            ...intervalIn(point?.interval, unit, joint.kind),
            maybeInUnit(point?.smoothed, unit, joint.kind),
            ...(points[i]?.limits ?? [null, null]),
            point?.change ? changeText(point.change) : (point?.reason ?? ""),
            text.usability[assessment.verdict],
          ];
        }),
      }}
    >
      {(width) =>
        points.some((p) => p.value !== null || p.low !== null) ? (
          <Trend
            points={points}
            bands={bandsOf(joint, unit)}
            width={width}
            label={words.joint(joint.name)}
            unit={label}
          />
        ) : (
          <p class="soft">{text.verdicts.unobservable}</p>
        )
      }
    </Figure>
  );
}

/** What is said at a point: its campaign, when, and what has changed. */
const sayer = (joint: TrendJoint, trend: Found) => (index: number) => {
  const [campaign, point] = [trend.campaigns[index], joint.points[index]];
  if (!campaign || !point) return "";
  const day = dayText(campaign.at);
  const said = point.change ? changeText(point.change) : (point.reason ?? words.roles[point.role]);
  const alarm = point.exceeded ? joint.alarms.filter((one) => one.since <= campaign.at).at(-1)?.message : undefined;
  return [
    campaign.name,
    campaign.time_source === "measured_at" ? day : words.stored(day),
    said,
    ...(campaign.assessment.verdict === "use" ? [] : [words.verdict(text.usability[campaign.assessment.verdict])]),
    ...(alarm ? [alarm] : []),
  ].join("\n");
};

/** State of a joint in words: its latest change, or what the pair says. */
function noteOf({ state, latest, pair }: TrendJoint): string {
  if (latest) return `${text.fleet.states[state]}: ${words.sinceBaseline(changeText(latest))}`;
  if (pair) return words.pair(changeText(pair.change), pValue(pair.p_value));
  return text.fleet.states[state];
}

function LeftOut({ trend }: { trend: Found }) {
  if (trend.left_out.length === 0) return null;
  return (
    <details>
      <summary>{words.leftOut(trend.left_out.length)}</summary>
      <Rows
        rows={trend.left_out.map(({ measurement_set_id: id, name, reason }) => ({
          id,
          href: link(["sets", id]),
          name,
          what: <Name>{name}</Name>,
          how: reason,
        }))}
      />
    </details>
  );
}
