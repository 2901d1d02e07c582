/** The joints of a run as one table and chart: stiffness on a logarithmic axis, in digits, its verdict, its part, and what to measure next. */
import type { JointResult, Advice, MeasurementSet, Posture, Robot, Run, Contribution, RunResult } from "../api/types";
import {
  axisStiffness,
  shownStiffness,
  STIFFNESS_UNITS,
  type StiffnessUnit,
  unitOf,
  verdictOf,
  position,
  positionUnit,
  capOf,
} from "../lib/stiffness";
import { text } from "../i18n";
import { clip, fixed, percent, significant, type Scale, extent, logarithmic } from "../lib/format";
import { BottomAxis, Chart, Figure } from "../charts/figure";
import { tip, Button, LinkButton, Name, Prose, Term, useWidth } from "../components/basics";
import { useMemo } from "preact/hooks";
import { api } from "../api/client";
import { PostureSketch } from "../components/posture";
import { norm, type Vector } from "../lib/vector";
import { useCached, valueOf } from "../state/load";
import { link, copied } from "../state/action";
import { Fragment } from "preact";
import { useSettings } from "../state/session";
import { type RunContext, isElastic } from "./run_context";

export interface IntervalMark {
  /** Which series: class of the mark. */
  mark: string;
  value: number | null;
  low: number | null;
  /** Null: no upper limit. */
  high: number | null;
  /** Said where there is nothing to draw. */
  instead?: string | null;
  label: string;
}

export interface IntervalRow {
  name: string;
  marks: IntervalMark[];
}

const MARK_HEIGHT = 26;
const ROW_GAP = 22;

interface IntervalsProps {
  rows: IntervalRow[];
  width: number;
  label: string;
  unit: string;
  format: (value: number) => string;
  /** Where a dashed line stands, such as no change. */
  reference?: number;
}

export function Intervals({ rows, width, label, unit, format, reference }: IntervalsProps) {
  const narrow = width < 480;
  const left = narrow ? 14 : 96;
  const right = width - 28;
  const head = narrow ? 22 : 0;
  const heights = rows.map((row) => head + spoken(row.marks).length * MARK_HEIGHT + ROW_GAP);
  const bottom = heights.reduce((sum, height) => sum + height, 8);
  const [low, high] = bounds(rows, reference);
  const x = logarithmic(low, high, left + 8, right, width < 480 ? 5 : 9);
  let top = 8;
  return (
    <Chart width={width} height={bottom + 52} label={label}>
      <BottomAxis scale={x} top={4} bottom={bottom} format={format} unit={unit} right={width - 8} />
      {reference !== undefined && <line class="reference" x1={x(reference)} x2={x(reference)} y1={4} y2={bottom} />}
      {rows.map((row, i) => {
        const start = top;
        top += heights[i] ?? 0;
        const middle = start + head + ROW_GAP / 2 + (spoken(row.marks).length * MARK_HEIGHT) / 2;
        return (
          <g>
            {i > 0 && <line class="between" x1={0} x2={width} y1={start} y2={start} />}
            <text
              class="row"
              x={narrow ? 4 : left - 10}
              y={narrow ? start + 22 : middle + 5}
              text-anchor={narrow ? "start" : "end"}
            >
              {clip(row.name, narrow ? 36 : 10)}
            </text>
            {spoken(row.marks).map((mark, k) => (
              <Mark
                mark={mark}
                x={x}
                y={start + head + ROW_GAP / 2 + (k + 0.5) * MARK_HEIGHT}
                left={left + 8}
                right={right}
              />
            ))}
          </g>
        );
      })}
    </Chart>
  );
}

/** Stiffnesses in the unit of the page. */
export const StiffnessIntervals = ({
  unit,
  ...rest
}: Pick<IntervalsProps, "rows" | "width" | "label"> & { unit: StiffnessUnit }) => (
  <Intervals {...rest} unit={STIFFNESS_UNITS[unit].label} format={axisStiffness(unit)} />
);

/** The axis of rows that stand in a table. */
export function intervalAxis(rows: IntervalRow[], width: number, margin: number): Scale {
  const [low, high] = bounds(rows, undefined);
  return logarithmic(low, high, margin, width - margin - 8, width < 320 ? 4 : 7);
}

export function RowAxis({
  axis,
  width,
  format,
  label,
}: {
  axis: Scale;
  width: number;
  format: (value: number) => string;
  label: string;
}) {
  return (
    <svg class="row-chart" width={width} height={22} role="img" aria-label={label}>
      {axis.ticks.map((tick) => (
        <text class="tick" x={axis(tick)} y={16} text-anchor="middle">
          {format(tick)}
        </text>
      ))}
    </svg>
  );
}

/** One row's marks above the lines of the axis. */
export function RowMarks({ row, axis, width }: { row: IntervalRow; axis: Scale; width: number }) {
  const marks = spoken(row.marks);
  const height = Math.max(40, marks.length * MARK_HEIGHT + 8);
  const top = (height - marks.length * MARK_HEIGHT) / 2;
  return (
    <svg
      class="row-chart"
      width={width}
      height={height}
      role="img"
      aria-label={row.marks.map((one) => one.label).join("; ")}
    >
      {axis.ticks.map((tick) => (
        <line class="grid" x1={axis(tick)} x2={axis(tick)} y1={0} y2={height} />
      ))}
      {marks.map((mark, k) =>
        mark.low === null && mark.value === null ? null : (
          <Mark mark={mark} x={axis} y={top + (k + 0.5) * MARK_HEIGHT} left={2} right={width - 10} />
        ),
      )}
    </svg>
  );
}

/** Where all series say the same instead of a value, once is enough. */
function spoken(marks: IntervalMark[]): IntervalMark[] {
  const silent = marks.every((mark) => mark.low === null && mark.value === null && mark.instead === marks[0]?.instead);
  return silent ? marks.slice(0, 1) : marks;
}

function Mark({
  mark,
  x,
  y,
  left,
  right,
}: {
  mark: IntervalMark;
  x: (value: number) => number;
  y: number;
  left: number;
  right: number;
}) {
  if (mark.low === null && mark.value === null) {
    return (
      <text class={`instead ${mark.mark}`} x={left} y={y + 5}>
        {mark.instead}
      </text>
    );
  }
  const from = mark.low !== null && mark.low > 0 ? x(mark.low) : left;
  const to = mark.high === null ? right : x(mark.high);
  const hidden = to - from < 15 && mark.value !== null; // the point covers the ends
  return (
    <g class={`interval ${mark.mark}`} {...tip(mark.label.split(": "))}>
      <rect class="hit" x={Math.min(from, to) - 10} y={y - 12} width={Math.abs(to - from) + 20} height={24} />
      <line x1={from} x2={mark.high === null && mark.low !== null ? to - 6 : to} y1={y} y2={y} />
      {mark.low !== null && !hidden && <line class="end" x1={from} x2={from} y1={y - 7} y2={y + 7} />}
      {mark.high !== null && mark.high !== mark.value && !hidden && (
        <line class="end" x1={to} x2={to} y1={y - 7} y2={y + 7} />
      )}
      {mark.high === null && mark.low !== null && <path class="head" d={`M${to + 8} ${y} l-15 -8 v16 z`} />}
      {mark.value !== null && <circle cx={x(mark.value)} cy={y} r={6.5} />}
    </g>
  );
}

/** The axis holds all numbers, with some room; open ends do not count. */
function bounds(rows: IntervalRow[], reference: number | undefined): [number, number] {
  const values = rows.flatMap((row) => row.marks.flatMap((mark) => [mark.value, mark.low, mark.high]));
  const found = extent([...values, reference ?? null].filter((value): value is number => value !== null && value > 0));
  const [low, high] = found ?? [1, 10];
  // a bar that ends near zero would leave no room for the others
  const points = extent(rows.flatMap((row) => row.marks.map((mark) => mark.value ?? 0)).filter((value) => value > 0));
  const least = points ? Math.max(low, points[0] / 1e3) : low;
  return [least / 1.25, Math.max(high * 1.25, least * 3)];
}

export function markOf(joint: JointResult, mark: string, unit: StiffnessUnit): IntervalMark {
  const shown = shownStiffness(joint, unit);
  const negative = joint.stiffness !== null && joint.stiffness < 0;
  // where it stands on the axis: its number in its own unit is that of the axis
  const scale = unitOf(unit, joint.kind).factor / unitOf(unit).factor;
  const [value, interval] = [onAxis(joint.stiffness, scale, unit), joint.stiffness_interval];
  const instead = negative ? `${text.run.negative}: ${shown.value ?? ""}` : text.verdicts[verdictOf(joint)];
  const range = shown.interval ? ` (${shown.interval.low} … ${shown.interval.high ?? "∞"})` : "";
  return {
    mark,
    value: negative ? null : value,
    low: onAxis(interval?.[0], scale, unit) ?? (negative ? null : value),
    high: interval ? onAxis(interval[1], scale, unit) : value,
    instead,
    label: `${joint.name}: ${shown.value ?? instead}${range} ${unitOf(unit, joint.kind).label}`,
  };
}

const onAxis = (stiffness: number | null | undefined, scale: number, unit: StiffnessUnit): number | null =>
  stiffness === null || stiffness === undefined
    ? null
    : STIFFNESS_UNITS[unit].inverse
      ? stiffness / scale
      : stiffness * scale;

const words = text.next;

interface Piece {
  advice: Advice;
  /** Null while it is on its way. */
  posture: Posture | null;
}

/** Pieces of advice with their postures. */
export function useAdvice(robot: Robot, advice: Advice[]): Piece[] {
  const joints = advice.map((one) => one.joints);
  const drawn = valueOf(
    useCached(
      `advice/${robot.id}/${JSON.stringify(joints)}`,
      async () => (joints.length > 0 ? (await api.kinematics({ robot_id: robot.id }, joints)).postures : []),
      Number.POSITIVE_INFINITY,
    ),
  );
  return useMemo(() => advice.map((one, i) => ({ advice: one, posture: drawn?.[i] ?? null })), [advice, drawn]);
}

export function NextMeasurement({
  pieces: [first, ...others],
  joint,
  run,
  set,
}: {
  pieces: Piece[];
  joint: JointResult;
  run: Run;
  set: MeasurementSet;
}) {
  if (!first) return null;
  return (
    <div role="row" class="next">
      <div role="cell">
        <One piece={first} joint={joint} run={run} set={set} />
        {others.length > 0 && (
          <details>
            <summary>{words.other}</summary>
            {others.map((piece) => (
              <One piece={piece} joint={joint} run={run} set={set} />
            ))}
          </details>
        )}
      </div>
    </div>
  );
}

function One({
  piece: { advice, posture },
  joint,
  run,
  set,
}: {
  piece: Piece;
  joint: JointResult;
  run: Run;
  set: MeasurementSet;
}) {
  const kinds = run.result?.joints.map(({ kind }) => kind) ?? [];
  const angles = advice.joints.map((value, i) => fixed(position(value, kinds[i]), 1));
  const copy = () => {
    const plain = angles.map((angle, i) => `A${i + 1} ${angle.replace("\u2212", "-")}`).join(", ");
    copied(plain, words.copy, words.copied);
  };
  return (
    <div class="piece">
      <PostureSketch posture={posture} force={advice.force as Vector} />
      <div>
        <p>
          <b>{words.title(joint.name)}</b>{" "}
          {advice.observation === null ? words.newPosture : words.posture(advice.observation)},{" "}
          {words.load(load(advice.force as Vector))}
        </p>
        <p class="angles">
          {angles.map((angle, i) => (
            <span>
              <small>A{i + 1}</small> {angle}
              {positionUnit(kinds[i])}
            </span>
          ))}
          <Button look="quiet" onClick={copy}>
            {words.copy}
          </Button>
          {advice.observation !== null && set.observations.some((one) => one.label === advice.observation) && (
            <LinkButton look="quiet" href={link(["runs", run.id, "robot"], { at: advice.observation })}>
              {words.show}
            </LinkButton>
          )}
        </p>
      </div>
      <p class="gain">
        <small class="soft">{words.gain}</small>
        <b>
          {before(joint)} → {afterwards(advice, joint)}
        </b>
      </p>
    </div>
  );
}

const load = (force: Vector): string => `${fixed(norm(force), 0)} ${text.units.newton} ${alongText(force)}`;

/** Where a force pulls, in words where it is a weight. */
export function alongText(force: Vector): string {
  const unit = force.map((part) => part / (norm(force) || 1));
  return (unit[2] ?? 0) < -0.9999 ? words.down : words.along(unit.map((part) => fixed(part, 2)).join(", "));
}

/** Standard uncertainty relative to the compliance. */
function before({ compliance, standard_uncertainty: u }: JointResult): string {
  return compliance === null || compliance <= 0 || u === null ? words.unknown : percent(u / compliance);
}

function afterwards(advice: Advice, { kind, compliance, standard_uncertainty: u }: JointResult): string {
  const { standard_uncertainty: after, uncertainty_ratio: ratio } = advice;
  if (compliance !== null && compliance > 0) {
    if (ratio !== null && u !== null) return percent((ratio * u) / compliance);
    if (after !== null) return percent(after / compliance);
  }
  const unit = kind === "prismatic" ? "nm/N" : "nrad/(N·m)";
  return after === null ? words.determined : `±\u00a0${significant(after * 1e9, 2)}\u00a0${unit}`;
}

const runWords = text.run;

export function JointTable({
  context: { run, set, robot },
  result,
  bare,
  tools,
}: {
  context: RunContext;
  result: RunResult;
  /** Without an axis: there is nothing to draw on it. */
  bare: boolean;
  tools: preact.ComponentChildren;
}) {
  const { unit } = useSettings();
  const mark = run.request.positive ? "positive" : "free";
  const rows = result.joints.map((joint): IntervalRow => ({ name: joint.name, marks: [markOf(joint, mark, unit)] }));
  const advice = useAdvice(robot, isElastic(run) ? [] : result.identifiability.advice);
  const chart = (width: number) => <StiffnessIntervals {...{ rows, width, unit, label: runWords.stiffness }} />;
  return (
    <Figure
      title={runWords.stiffness}
      {...(bare ? {} : { note: runWords.stiffnessNote(percent(run.request.confidence)) })}
      tools={tools}
      drawing={chart}
    >
      {() => (
        <Rows
          rows={rows}
          joints={result.joints}
          contributions={result.contributions}
          level={percent(run.request.confidence)}
          unit={unit}
          bare={bare}
          after={(joint) => (
            <NextMeasurement
              pieces={advice.filter((one) => one.advice.joint === joint.name)}
              joint={joint}
              run={run}
              set={set}
            />
          )}
        />
      )}
    </Figure>
  );
}

function Rows({
  rows,
  joints,
  contributions,
  level,
  unit,
  bare,
  after,
}: {
  rows: IntervalRow[];
  joints: JointResult[];
  contributions: Contribution[];
  level: string;
  unit: StiffnessUnit;
  bare: boolean;
  after: (joint: JointResult) => preact.ComponentChildren;
}) {
  const [head, width] = useWidth<HTMLDivElement>();
  const axis = intervalAxis(rows, Math.max(60, width), 10);
  const parts = new Map(contributions.map((one) => [one.joint, one]));
  const shares = !bare && contributions.some(({ mean }) => mean !== 0);
  const most = Math.max(0, ...contributions.map(({ share }) => Math.abs(share)));
  const format = axisStiffness(unit);
  return (
    <div
      class={shares ? "joints shares" : bare ? "joints bare" : "joints"}
      role="table"
      aria-label={runWords.stiffness}
    >
      <div class={bare ? "joint-head hidden" : "joint-head"} role="row">
        <span role="columnheader">{runWords.joint}</span>
        <div role="columnheader" class="bar" ref={head}>
          {width > 0 && !bare && (
            <RowAxis axis={axis} width={width} format={format} label={STIFFNESS_UNITS[unit].label} />
          )}
        </div>
        <span role="columnheader" class="number">
          {runWords.quantity(unit === "compliance")} <small>{STIFFNESS_UNITS[unit].label}</small>
        </span>
        <span role="columnheader" class="number">
          <Term of="interval">{runWords.interval(level)}</Term>
        </span>
        <span role="columnheader">{runWords.verdict}</span>
        {shares && <span role="columnheader">{runWords.contribution}</span>}
      </div>
      {joints.map((joint, i) => {
        const shown = shownStiffness(joint, unit);
        const [verdict, cap, part] = [verdictOf(joint), capOf(joint), parts.get(joint.name)];
        const limited = verdict === "lower_limit" && shown.limit !== null;
        return (
          <Fragment key={joint.name}>
            <div class={`joint ${verdict}`} role="row">
              <span role="rowheader">
                <Name>{joint.name}</Name>
              </span>
              <div role="cell" class="bar">
                {width > 0 && !bare && <RowMarks row={rows[i] as IntervalRow} axis={axis} width={width} />}
              </div>
              <span role="cell" class="number value">
                <b>{verdict === "unobservable" ? "–" : limited ? shown.limit : (shown.value ?? "∞")}</b>
                {!limited && shown.uncertainty !== null && <span class="soft"> ±&nbsp;{shown.uncertainty}</span>}
                {verdict !== "unobservable" && joint.kind !== "prismatic" && (
                  <small class="unit soft"> {unitOf(unit).label}</small>
                )}
              </span>
              <span role="cell" class="number interval-text">
                {shown.interval === null || limited ? "–" : `${shown.interval.low} … ${shown.interval.high ?? "∞"}`}
              </span>
              <span role="cell" class="verdict" title={text.verdictHints[verdict]}>
                <span class={cap ? `lamp ${cap}` : "lamp"} aria-hidden="true" />
                {cap ? text.usability[cap] : text.verdicts[verdict]}
              </span>
              {shares && part && part.mean !== 0 && (
                <span role="cell" class="part">
                  <svg width={SHARE_WIDTH} height={10} aria-hidden="true">
                    <rect class="share-bar" width={(Math.abs(part.share) / most) * SHARE_WIDTH} height={10} rx={2} />
                  </svg>
                  <b>{percent(part.share)}</b>
                  <span class="soft">
                    {fixed(part.mean * 1e3, 3)} {text.units.mm}
                  </span>
                </span>
              )}
              {shares && !part?.mean && (
                <span role="cell" class="part soft">
                  –
                </span>
              )}
            </div>
            {after(joint)}
          </Fragment>
        );
      })}
      {reasonsOf(joints).map(([reason, names]) => (
        <div class="reason soft" role="row">
          <span role="cell">
            <Name>{names.join(", ")}</Name>: <Prose text={reason} />
          </span>
        </div>
      ))}
    </div>
  );
}

/** Why joints are uncertain: each reason once, with the names of the joints that it is true of. */
function reasonsOf(joints: JointResult[]): [string, string[]][] {
  const names = new Map<string, string[]>();
  for (const { name, reason } of joints) if (reason) names.set(reason, [...(names.get(reason) ?? []), name]);
  return [...names];
}

const SHARE_WIDTH = 64;

/** Stiffnesses of several fits beside each other. */
export function StiffnessFigure({
  title,
  level,
  series,
  tools,
}: {
  title: string;
  /** Of the intervals. */
  level: string;
  series: { label: string; mark: string; joints: JointResult[] }[];
  tools?: preact.ComponentChildren;
}) {
  const { unit } = useSettings();
  const names = [...new Set(series.flatMap(({ joints }) => joints.map(({ name }) => name)))];
  const rows = names.map((name) => ({
    name,
    marks: series.flatMap(({ joints, mark }) =>
      joints.filter((joint) => joint.name === name).map((joint) => markOf(joint, mark, unit)),
    ),
  }));
  return (
    <Figure title={title} note={runWords.stiffnessNote(level)} legend={series} tools={tools}>
      {(width) => <StiffnessIntervals {...{ rows, width, unit, label: title }} />}
    </Figure>
  );
}
