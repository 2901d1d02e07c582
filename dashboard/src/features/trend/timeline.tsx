/** All campaigns of an arm over one axis of time: a row for each joint, in order, with the band of no change. */
import type { Mark as Event, Trend, TrendCampaign, TrendJoint } from "../../api/types";
import { Chart, Figure } from "../../charts/figure";
import { Name, tip } from "../../components/basics";
import { Estimate } from "../../components/estimate";
import { alike, type Cell } from "../../components/table";
import { estimateText } from "../../lib/estimate";
import { clip, dayText, extent, pValue, type Scale, timeText } from "../../lib/format";
import { onAxis, shownWithInterval, unitOf } from "../../lib/stiffness";
import { go, link } from "../../state/action";
import { useSettings } from "../../state/session";
import { text } from "../../words";
import { Mark } from "../run/joint_table";
import { changeText, comparedText, firstCompared, placesOf, ticksOf, whenTexts } from "./trend";
import { trendWords as words } from "./words";

/** Across becomes up: marks are drawn along x. */
const UPRIGHT = "matrix(0 1 1 0 0 0)";

/** Least and greatest ratio of a row's end to its middle; a row is as wide as the widest needs. */
const [LEAST, GREATEST] = [1.12, 3];

/** Height of a row, of its name where that has no column of its own, and of the axis [px]. */
const [ROW, HEAD, AXIS] = [58, 24, 34];

/** Heights of the flags of marks. */
const FLAGS = 22;

/** From the last campaign to the end of a narrow drawing [px]: a name and its change share a line. */
const EDGE = 14;
const NARROW = 620;

/** A joint's stiffness relative to that with which it is compared; null without one. */
function middleOf({ points }: TrendJoint, first: number): number | null {
  const known = points[first]?.stiffness ?? points.find(({ stiffness }) => stiffness)?.stiffness;
  return known && known > 0 ? known : null;
}

/** How far the rows reach, as a ratio. */
function reachOf(trend: Trend): number {
  const ratios = trend.joints.flatMap((joint) => {
    const middle = middleOf(joint, firstCompared(trend, joint));
    if (middle === null) return [];
    const values = joint.points.flatMap(({ stiffness, interval, reason }) =>
      reason === null ? [stiffness, ...(interval ?? [])] : [],
    );
    const ends = values.flatMap((value) => (value && value > 0 ? [value / middle] : []));
    return [...ends, ...(joint.unchanged ?? [])];
  });
  const [low, high] = extent(ratios) ?? [1, 1];
  return Math.min(GREATEST, Math.max(LEAST, 1.05 * Math.max(high, 1 / low)));
}

interface DrawnProps {
  trend: Trend;
  marks: Event[];
  width: number;
}

function Drawn({ trend, marks, width }: DrawnProps) {
  const { campaigns, joints } = trend;
  const narrow = width < NARROW;
  const [left, right] = [narrow ? 14 : 210, width - 16];
  const head = narrow ? HEAD : 8;
  const top = marks.length > 0 ? FLAGS : 4;
  const bottom = top + joints.length * (ROW + head);
  const times = campaigns.map(({ at }) => Date.parse(at));
  const { places, timeAt } = placesOf(
    times,
    marks.map(({ at }) => Date.parse(at)),
    left + 14,
    right - 14,
  );
  const reach = reachOf(trend);
  const when = whenTexts(campaigns.map(({ at }) => at));
  return (
    <Chart width={width} height={bottom + AXIS} label={words.chart} links>
      <g class="axis">
        {timeAt &&
          ticksOf(times, marks, (right - left) / 110).map(({ time, label }) => {
            const x = timeAt(time);
            return x < left || x > right ? null : (
              <g>
                <line x1={x} x2={x} y1={top} y2={bottom} />
                <text x={x} y={bottom + 22} text-anchor={x > right - 30 ? "end" : x < left + 30 ? "start" : "middle"}>
                  {label}
                </text>
              </g>
            );
          })}
      </g>
      {timeAt &&
        marks.map(({ at, note }, i) => {
          const x = timeAt(Date.parse(at));
          return (
            <g class="event" {...tip([dayText(at), note])}>
              <rect class="hit" x={x - 8} y={0} width={16} height={bottom} />
              <line x1={x} x2={x} y1={14} y2={bottom} />
              <text x={x} y={13} text-anchor="middle">
                {i + 1}
              </text>
            </g>
          );
        })}
      {joints.map((joint, j) => {
        const upper = top + j * (ROW + head) + head;
        return <Row key={joint.name} {...{ joint, trend, places, reach, narrow, left, right, upper }} />;
      })}
      {campaigns.map((campaign, i) => {
        const open = link(["runs", campaign.run_id]);
        const lines = linesOf(campaign, when[i] ?? "");
        return (
          <g
            class="campaign"
            role="link"
            tabindex={0} // of an SVG element: its attributes keep their case
            aria-label={lines.join(", ")}
            onKeyDown={(event: KeyboardEvent) => event.key === "Enter" && go(open)}
          >
            <rect
              class="hit column"
              x={(places[i] ?? 0) - 8}
              y={top}
              width={16}
              height={bottom - top}
              {...tip([...lines, ...joints.map((joint) => valueText(joint, i))], open)}
            />
          </g>
        );
      })}
    </Chart>
  );
}

/** A campaign in words: its name, when it was, and what limits it. */
const linesOf = (campaign: TrendCampaign, when: string): string[] => [
  campaign.name,
  campaign.time_source === "measured_at" ? when : words.stored(when),
  ...(campaign.verdict === "use" ? [] : [words.verdict(text.usability[campaign.verdict])]),
];

/** A joint in a campaign, in the unit of the page's tables. */
function valueText(joint: TrendJoint, i: number): string {
  const { stiffness = null, interval = null, reason = null } = joint.points[i] ?? {};
  const shown = estimateText(shownWithInterval(stiffness, interval, "MNm", joint.kind));
  return `${joint.name}: ${reason === null ? shown : reason}`;
}

interface RowProps {
  joint: TrendJoint;
  trend: Trend;
  places: number[];
  reach: number;
  narrow: boolean;
  left: number;
  right: number;
  upper: number;
}

/** Most letters of a name beside its change on a phone. */
const LONGEST_NAME = 22;

function Row({ joint, trend, places, reach, narrow, left, right, upper }: RowProps) {
  const first = firstCompared(trend, joint);
  const middle = middleOf(joint, first);
  const centre = upper + ROW / 2;
  const inside = (y: number) => Math.min(upper + ROW, Math.max(upper, y));
  const place = (ratio: number) => inside(centre - (Math.log(ratio) / Math.log(reach)) * (ROW / 2));
  const y: Scale = Object.assign(place, { ticks: [] });
  const { change, changed, unchanged } = joint;
  const said = change ? changeText(change) : words.notTested;
  const from = places[first] ?? left;
  return (
    <g class={changed ? "joint-row changed" : "joint-row"}>
      <line
        class="between"
        x1={narrow ? 0 : 4}
        x2={right}
        y1={upper - (narrow ? HEAD : 4)}
        y2={upper - (narrow ? HEAD : 4)}
      />
      <text class="row" x={narrow ? 0 : 4} y={narrow ? upper - 6 : centre - 2}>
        {narrow ? clip(joint.name, LONGEST_NAME) : joint.name}
      </text>
      <text
        class="said"
        x={narrow ? right + EDGE : 4}
        y={narrow ? upper - 6 : centre + 18}
        text-anchor={narrow ? "end" : "start"}
      >
        {said}
      </text>
      {middle === null ? (
        <text class="said" x={left + 14} y={centre + 5}>
          {text.verdicts.unobservable[0]}
        </text>
      ) : (
        <>
          {unchanged && (
            <rect
              class="unchanged"
              x={from}
              width={Math.max(0, right - from)}
              y={y(unchanged[1])}
              height={Math.max(2, y(unchanged[0]) - y(unchanged[1]))}
            />
          )}
          <line class="reference" x1={from} x2={right} y1={centre} y2={centre} />
          {joint.points.map((point, i) => {
            const { stiffness, interval } = relative(point, middle);
            const value = stiffness ?? null;
            const [low, high] = [interval?.[0] ?? null, interval ? interval[1] : value];
            if (value === null && low === null) return null;
            const mark = point.reason === null ? "method-1" : "free";
            return (
              <g transform={UPRIGHT}>
                <Mark
                  mark={{ mark, value, low, high, lines: [] }}
                  x={y}
                  y={places[i] ?? 0}
                  left={upper + ROW}
                  right={upper}
                />
              </g>
            );
          })}
        </>
      )}
    </g>
  );
}

/** A point relative to a stiffness. */
const relative = ({ stiffness = null, interval = null }: TrendJoint["points"][number], middle: number) => ({
  stiffness: stiffness === null ? null : stiffness / middle,
  interval:
    interval && ([interval[0] / middle, interval[1] === null ? null : interval[1] / middle] as [number, number]),
});

interface TimelineProps {
  trend: Trend;
  marks: Event[];
}

export function Timeline({ trend, marks }: TimelineProps) {
  const { unit } = useSettings();
  const { campaigns, joints } = trend;
  const shown = marks.filter(({ serial_number: of }) => of === null || of === trend.selection?.serial_number);
  const named = (joint: TrendJoint) => `${joint.name} [${unitOf(unit, joint.kind).label}]`;
  const cells = (i: number): Cell[] =>
    joints.map(({ points, kind }) => {
      const { stiffness = null, interval = null } = points[i] ?? {};
      return <Estimate of={shownWithInterval(stiffness, interval, unit, kind)} />;
    });
  const numbers = (i: number): Cell[] =>
    joints.flatMap(({ points, kind }): Cell[] => {
      const { value, low, high } = onAxis(points[i] ?? {}, unit, kind);
      return [value, low, points[i]?.interval ? high : null, points[i]?.reason ?? ""];
    });
  return (
    <Figure
      title={words.timeline}
      legend={[
        { mark: "band unchanged", label: words.band },
        ...(shown.length > 0 ? [{ mark: "dashed", label: words.marked }] : []),
      ]}
      table={{
        columns: [text.sets.kind, text.runs.when, ...joints.map(named), text.run.verdict],
        texts: [0, 1, joints.length + 2],
        rows: campaigns.map(({ name, at, verdict }, i) => [name, timeText(at), ...cells(i), text.usability[verdict]]),
      }}
      file={{
        columns: [
          text.sets.kind,
          text.runs.when,
          ...joints.flatMap((joint) => [
            ...alike(
              [joint.name, `${joint.name} ${text.run.low}`, `${joint.name} ${text.run.high}`],
              unitOf(unit, joint.kind).column,
            ),
            `${joint.name}: ${words.reason}`,
          ]),
          text.run.verdict,
        ],
        rows: campaigns.map(({ name, at, verdict }, i) => [name, timeText(at), ...numbers(i), text.usability[verdict]]),
      }}
    >
      {(width) => <Drawn trend={trend} marks={shown} width={width} />}
    </Figure>
  );
}

/** The joints that changed, each in a line: by how much, from which campaign to which. */
export const ChangedLines = ({ trend }: { trend: Trend }) => (
  <>
    {trend.joints
      .filter(({ changed }) => changed)
      .map((joint) => (
        <p key={joint.name} class="note bad">
          <b class="state changed">{words.changed}</b> <Name>{joint.name}</Name>{" "}
          {joint.change && `${changeText(joint.change)} ${comparedText(trend, joint)}`}
        </p>
      ))}
  </>
);

/** The test of each joint in words. */
export const TestsOfJoints = ({ trend }: { trend: Trend }) => (
  <ul class="tests">
    {trend.joints.map((joint) => (
      <li>
        <Name>{joint.name}</Name>: {noteOf(joint, trend)}
      </li>
    ))}
  </ul>
);

/** The test of a joint in words: its change between two campaigns. */
const noteOf = (joint: TrendJoint, trend: Trend): string => {
  const { change, p_value: p, changed } = joint;
  if (!change || p === null) return words.untested;
  return words.pair(changed, changeText(change), comparedText(trend, joint), pValue(p));
};
