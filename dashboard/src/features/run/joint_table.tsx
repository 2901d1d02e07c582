/** The joints of a run as one table and chart: stiffness on a logarithmic axis, in digits, its verdict, its part, and what to measure next. */
import type { JointResult, Advice, Posture, Robot, RunResult, Usability } from "../../api/types";
import {
  axisStiffness,
  shownStiffness,
  STIFFNESS_UNITS,
  type StiffnessUnit,
  type Verdict,
  unitOf,
  verdictOf,
  position,
  positionUnit,
  capOf,
  isRefuted,
  withUnit,
  roughStiffness,
} from "../../lib/stiffness";
import { text } from "../../words";
import { clip, fixed, percent, extent, logarithmic, namedTicks } from "../../lib/format";
import { estimateText, NORMAL_95, type ShownEstimate } from "../../lib/estimate";
import { BottomAxis, Chart, Figure } from "../../charts/figure";
import { Estimate, EstimateBar, EstimateInterval, EstimateValue, hasBar } from "../../components/estimate";
import { tip, Button, LinkButton, Name, Prose, Term, usePhone, useWidth } from "../../components/basics";
import { queries } from "../../api/queries";
import { PostureSketch } from "../../components/posture";
import { groupedBy } from "../../lib/json";
import { norm, type Vector } from "../../lib/vector";
import { useQuery } from "../../state/query";
import { link, copied } from "../../state/action";
import { Fragment } from "preact";
import { useState } from "preact/hooks";
import { useSettings } from "../../state/session";
import { type RunContext, isElastic } from "../../state/run_context";
import { chooseJoint } from "./chosen";
import { nextWords, partWords } from "./words";

/** Characters of the longest name of a joint that stands in one line of the table on a desk. */
const LONG_NAME = 20;

/** A value with its interval. */
export interface IntervalMark {
  /** Which series: class of the mark. */
  mark: string;
  value: number | null;
  low: number | null;
  /** Null: no upper limit. */
  high: number | null;
  /** Said where there is nothing to draw. */
  instead?: string | null;
  /** Said when it is pointed at: a heading, and values. */
  lines: string[];
  /** Address that it leads to. */
  open?: string;
}

interface IntervalRow {
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
  const marks = rows.flatMap((row) => row.marks);
  const x = logarithmic(...bounds(marks, reference), left + 8, right, width < 480 ? 5 : 9);
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

/** Where all series say the same instead of a value, once is enough. */
function spoken(marks: IntervalMark[]): IntervalMark[] {
  const silent = marks.every((mark) => mark.low === null && mark.value === null && mark.instead === marks[0]?.instead);
  return silent ? marks.slice(0, 1) : marks;
}

/** A mark on a scale from `left` to `right`, where what is open ends. */
export function Mark({ mark, x, y, left, right }: MarkProps) {
  const { value, low, high } = mark;
  if (low === null && value === null) {
    return (
      <text class={`instead ${mark.mark}`} x={left} y={y + 5}>
        {mark.instead}
      </text>
    );
  }
  const from = low === null ? x(value ?? 0) : low > 0 ? x(low) : left;
  const to = high === null ? right : x(high);
  const out = Math.sign(right - left);
  const isOpen = high === null && low !== null;
  return (
    <g class={`interval ${mark.mark}`} {...tip(mark.lines, mark.open)}>
      <rect class="hit" x={Math.min(from, to) - 10} y={y - 12} width={Math.abs(to - from) + 20} height={24} />
      {low !== null && <line x1={from} x2={isOpen ? to - 6 * out : to} y1={y} y2={y} />}
      {low !== null && low !== high && <line class="end" x1={from} x2={from} y1={y - 8} y2={y + 8} />}
      {low !== null && high !== null && high !== value && <line class="end" x1={to} x2={to} y1={y - 8} y2={y + 8} />}
      {isOpen && <path class="head" d={`M${to + 8 * out} ${y}l${-15 * out} -8v16z`} />}
      {value !== null && value > 0 && <circle cx={x(value)} cy={y} r={4.5} />}
    </g>
  );
}

interface MarkProps {
  mark: IntervalMark;
  x: (value: number) => number;
  y: number;
  left: number;
  right: number;
}

/** The axis holds all numbers, with some room; open ends do not count. */
function bounds(marks: IntervalMark[], reference?: number): [number, number] {
  const values = marks.flatMap((mark) => [mark.value, mark.low, mark.high]);
  const found = extent([...values, reference ?? null].filter((value): value is number => value !== null && value > 0));
  const [low, high] = found ?? [1, 10];
  // a bar that ends near zero would leave no room for the others
  const points = extent(marks.map((mark) => mark.value ?? 0).filter((value) => value > 0));
  const least = points ? Math.max(low, points[0] / 1e3) : low;
  return [least / 1.25, Math.max(high * 1.25, least * 3)];
}

function markOf(joint: JointResult, mark: string, unit: StiffnessUnit): IntervalMark {
  const shown = shownStiffness(joint, unit);
  const negative = joint.stiffness !== null && joint.stiffness < 0;
  // where it stands on the axis: its number in its own unit is that of the axis
  const scale = unitOf(unit, joint.kind).factor / unitOf(unit).factor;
  const [value, interval] = [onAxis(joint.stiffness, scale), isRefuted(joint) ? null : joint.stiffness_interval];
  const standing = isRefuted(joint) ? text.usability.do_not_use : text.verdicts[verdictOf(joint)][0];
  const instead = negative ? `${text.run.negative}: ${estimateText(shown)}` : standing;
  const beside = joint.kind === "prismatic" ? "" : unitOf(unit).label; // whose value has its unit
  return {
    mark: shown.unusable ? `${mark} unusable` : mark,
    value: negative ? null : value,
    low: onAxis(interval?.[0], scale) ?? (negative ? null : value),
    high: interval ? onAxis(interval[1], scale) : value,
    instead,
    lines: [joint.name, shown.value === null ? instead : withUnit(estimateText(shown), beside)],
  };
}

const onAxis = (stiffness: number | null | undefined, scale: number): number | null =>
  stiffness === null || stiffness === undefined ? null : stiffness * scale;

const words = nextWords;

interface Piece {
  advice: Advice;
  /** Null while it is on its way. */
  posture: Posture | null;
}

/** Pieces of advice with their postures. */
function useAdvice(robot: Robot, advice: Advice[]): Piece[] {
  const joints = advice.map((one) => one.joints);
  const { data: drawn } = useQuery(queries.kinematics(joints.length > 0 ? { robot_id: robot.id } : null, joints));
  return advice.map((one, i) => ({ advice: one, posture: drawn?.[i] ?? null }));
}

/** What to measure next for a joint: one piece of advice, and folded away what else would do. */
function NextMeasurement({ pieces, ...about }: { pieces: Piece[]; joint: JointResult; context: RunContext }) {
  const [first, ...others] = pieces.map((piece) => <One piece={piece} {...about} />);
  if (!first) return null;
  return (
    <div role="row" class="next">
      <div role="cell">
        {first}
        {others.length > 0 && (
          <details>
            <summary>{words.other}</summary>
            {others}
          </details>
        )}
      </div>
    </div>
  );
}

interface OneProps {
  piece: Piece;
  joint: JointResult;
  context: RunContext;
}

function One({ piece: { advice, posture }, joint, context: { run, set } }: OneProps) {
  const { unit } = useSettings();
  const kinds = run.result?.joints.map(({ kind }) => kind) ?? [];
  const names = run.result?.joints.map(({ name }) => name) ?? [];
  const angles = advice.joints.map((value, i) => fixed(position(value, kinds[i]), 1));
  const copy = () => {
    const plain = angles.map((angle, i) => `${names[i]} ${angle.replace("\u2212", "-")}`).join(", ");
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
              <small>
                <Name>{names[i] ?? ""}</Name>
              </small>{" "}
              {angle}
              {positionUnit(kinds[i])}
            </span>
          ))}
          <Button look="quiet" onClick={copy}>
            {words.copy}
          </Button>
          {advice.observation !== null && set.observations.some((one) => one.label === advice.observation) && (
            <LinkButton look="quiet" href={link(["runs", run.id, "robot"], { at: advice.observation })}>
              {text.figure.open}
            </LinkButton>
          )}
        </p>
      </div>
      <p class="gain">
        <small class="soft">{words.gain}</small>
        <b>
          {before(joint)} → {afterwards(advice, joint, unit)}
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

/** Half of the interval, relative to the compliance; null where that is unknown. */
function halfWidth({ compliance, compliance_interval: ends }: JointResult): number | null {
  return !compliance || compliance < 0 || !ends ? null : (ends[1] - ends[0]) / 2 / compliance;
}

function before(joint: JointResult): string {
  const half = halfWidth(joint);
  return half === null ? words.unknown : `± ${percent(half)}`;
}

function afterwards(advice: Advice, joint: JointResult, unit: StiffnessUnit): string {
  const { standard_uncertainty: after, uncertainty_ratio: ratio } = advice;
  const { kind, compliance } = joint;
  const half = halfWidth(joint);
  if (ratio !== null && half !== null) return `± ${percent(ratio * half)}`;
  if (compliance && compliance > 0 && after !== null) return `± ${percent((NORMAL_95 * after) / compliance)}`;
  if (after === null) return text.verdicts.fair[0];
  const shown = (stiffness: number) => roughStiffness(stiffness, unit, kind);
  return words.below(shown(0.5 / after));
}

const runWords = text.run;

interface TableProps {
  context: RunContext;
  result: RunResult;
  /** Without an axis: there is nothing to draw on it. */
  bare: boolean;
  /** Name of the joint that the arm shows. */
  chosen: string | null;
}

/** The stiffness of a joint with its interval, in the unit of the page. */
export const Stiffness = ({ joint }: { joint: JointResult }) => (
  <Estimate of={shownStiffness(joint, useSettings().unit)} />
);

export function JointTable(shown: TableProps) {
  const { unit } = useSettings();
  const { result, bare, context } = shown;
  const level = percent(context.run.request.confidence);
  const rows = result.joints.map((joint) => ({ name: joint.name, marks: [markOf(joint, markIn(context), unit)] }));
  return (
    <Figure
      title={`${runWords.stiffness} [${STIFFNESS_UNITS[unit].label}]`}
      {...(bare ? {} : { note: runWords.stiffnessNote(level) })}
      drawing={bare ? null : (width) => <StiffnessIntervals {...{ rows, width, unit, label: runWords.stiffness }} />}
    >
      {() => <Rows {...shown} />}
    </Figure>
  );
}

const markIn = ({ run }: RunContext): string => (run.request.positive ? "positive" : "free");

function Rows({ context, result, bare, chosen }: TableProps) {
  const { joints, contributions, identifiability, assessment, gearboxes, structures } = result;
  const { run, robot } = context;
  const { unit } = useSettings();
  const [head, width] = useWidth<HTMLDivElement>();
  const advice = useAdvice(robot, isElastic(run) ? [] : identifiability.advice);
  const marks = joints.map((joint) => markOf(joint, markIn(context), unit));
  const drawn = width > 0 && !bare;
  const phone = usePhone();
  const areLong = joints.some(({ name }) => name.length > SHORT_NAME);
  const hasArm = result.residuals.length > 0;
  /** Joints of which a phone shows more than one line. */
  const [opened, setOpened] = useState<ReadonlySet<string>>(new Set());
  const toggle = (name: string) => {
    const isOpen = opened.has(name);
    setOpened(new Set(isOpen ? [...opened].filter((one) => one !== name) : [...opened, name]));
    if (hasArm && isOpen === (chosen === name)) chooseJoint(name);
  };
  const axis = logarithmic(...bounds(marks), 10, Math.max(60, width) - 18, width < 160 ? 2 : width < 320 ? 4 : 7);
  const parts = new Map(contributions.map((one) => [one.joint, one]));
  const shares = !bare && contributions.some(({ mean }) => mean !== 0);
  const most = Math.max(0, ...contributions.map(({ share }) => Math.abs(share)));
  const { label } = STIFFNESS_UNITS[unit];
  /** Why joints are uncertain: each reason once. */
  const reasons = groupedBy(
    joints.filter(({ reason }) => reason),
    ({ reason }) => reason ?? "",
  );
  return (
    <div class="joint-rows">
      <div
        class={`joints${shares ? " shares" : bare ? " bare" : ""}${areLong ? " long-names" : ""}`}
        role="table"
        aria-label={runWords.stiffness}
      >
        <div class={bare ? "joint-head hidden" : "joint-head"} role="row">
          <span role="columnheader">{runWords.joint}</span>
          <div role="columnheader" class="bar" ref={head}>
            {drawn && (
              <svg class="row-chart" width={width} height={22} role="img" aria-label={label}>
                {namedTicks(axis, axisStiffness(unit)).map(({ x, name }) => (
                  <text class="tick" x={x} y={16} text-anchor="middle">
                    {name}
                  </text>
                ))}
              </svg>
            )}
          </div>
          <span role="columnheader" class="number">
            {runWords.quantity}
          </span>
          <span role="columnheader" class="number">
            <Term of="interval">{runWords.interval(percent(run.request.confidence))}</Term>
          </span>
          <span role="columnheader">{runWords.verdict}</span>
          {shares && <span role="columnheader">{runWords.contribution}</span>}
        </div>
        {joints.map((joint, i) => {
          const mark = marks[i] as IntervalMark;
          const shown = shownOrTied(joint, identifiability.combinations, unit);
          const [verdict, cap, part] = [verdictOf(joint), capOf(joint), parts.get(joint.name)];
          const open = !phone || opened.has(joint.name);
          return (
            <Fragment key={joint.name}>
              <div class={classOf(verdict, open, shown.unusable, joint.name === chosen)} role="row">
                <span role="rowheader">
                  {phone ? (
                    <button type="button" class="opens" aria-expanded={open} onClick={() => toggle(joint.name)}>
                      <BrokenName of={joint.name} />
                    </button>
                  ) : hasArm ? (
                    <button
                      type="button"
                      class={joint.name.length > LONG_NAME ? "chooses long" : "chooses"}
                      aria-pressed={joint.name === chosen}
                      onClick={() => chooseJoint(joint.name)}
                    >
                      <Name>{joint.name}</Name>
                    </button>
                  ) : (
                    <Name>{joint.name}</Name>
                  )}
                </span>
                <div role="cell" class="bar">
                  {drawn && (
                    <svg class="row-chart" width={width} height={ROW} role="img" aria-label={mark.lines.join(": ")}>
                      {axis.ticks.map((tick) => (
                        <line class="grid" x1={axis(tick)} x2={axis(tick)} y1={0} y2={ROW} />
                      ))}
                      {(mark.low ?? mark.value) !== null && (
                        <Mark mark={mark} x={axis} y={ROW / 2} left={2} right={width - 10} />
                      )}
                    </svg>
                  )}
                </div>
                <span role="cell" class="number value">
                  {hasBar(shown) && <EstimateBar of={shown} />}
                  <EstimateValue of={shown} />
                  {(shown.value ?? shown.limit) !== null &&
                    verdict !== "unobservable" &&
                    joint.kind !== "prismatic" && <small class="unit soft">{withUnit("", unitOf(unit).label)}</small>}
                </span>
                <span role="cell" class="number interval-text">
                  <EstimateInterval of={shown} />
                </span>
                <span role="cell" class="verdict" title={text.verdicts[verdict][1]}>
                  <span class={cap ? `lamp ${cap}` : "lamp"} aria-hidden="true" />
                  <span class={isPlain(verdict, cap, assessment.verdict) ? "word hidden" : "word"}>
                    {cap ? text.usability[cap] : text.verdicts[verdict][0]}
                  </span>
                </span>
                {shares && !part?.mean && (
                  <span role="cell" class="part soft">
                    –
                  </span>
                )}
                {shares && part && part.mean !== 0 && (
                  <span role="cell" class="part">
                    <svg width={SHARE_WIDTH} height={10} aria-hidden="true">
                      <rect class="share-bar" width={(Math.abs(part.share) / most) * SHARE_WIDTH} height={10} rx={2} />
                    </svg>
                    {shown.unusable ? <span>{percent(part.share)}</span> : <b>{percent(part.share)}</b>}
                    <span class="soft of">{runWords.ofDeflection}</span>
                    <span class="soft length">
                      {fixed(part.mean * 1e3, 3)} {text.units.mm}
                    </span>
                  </span>
                )}
              </div>
              {open && (
                <NextMeasurement
                  pieces={advice.filter((one) => one.advice.joint === joint.name)}
                  joint={joint}
                  context={context}
                />
              )}
            </Fragment>
          );
        })}
        <Reasons of={reasons} />
        {!bare && <Parts {...{ gearboxes, structures, unit }} />}
      </div>
    </div>
  );
}

/** A name that takes several lines, parted after its marks. */
const BrokenName = ({ of: name }: { of: string }) => (
  <bdi class="name">
    {name.split(/(?<=[_.:-])/).map((piece, i) => (
      <Fragment key={i}>
        {i > 0 && <wbr />}
        {piece}
      </Fragment>
    ))}
  </bdi>
);

function classOf(verdict: Verdict, isOpen: boolean, isUnusable: boolean, isChosen: boolean): string {
  const states = { closed: !isOpen, unusable: isUnusable, chosen: isChosen };
  return ["joint", verdict, ...Object.entries(states).flatMap(([name, holds]) => (holds ? [name] : []))].join(" ");
}

/** Gearboxes and structure of joints with encoders between the two: a line for each joint. */
function Parts({ gearboxes, structures, unit }: Pick<RunResult, "gearboxes" | "structures"> & { unit: StiffnessUnit }) {
  return (
    <>
      {gearboxes.map((gearbox, i) => (
        <div class="reason soft" role="row" key={gearbox.name}>
          <span role="cell">
            <Name>{gearbox.name}</Name>: {partWords.gearbox} <Estimate of={shownStiffness(gearbox, unit)} />,{" "}
            {partWords.structure} <Estimate of={shownStiffness(structures[i] as JointResult, unit)} />{" "}
            {unitOf(unit).label}
          </span>
        </div>
      ))}
    </>
  );
}

/** A stiffness, or in its place the joints without which the readings do not show it. */
function shownOrTied(joint: JointResult, groups: string[][], unit: StiffnessUnit): ShownEstimate {
  const shown = shownStiffness(joint, unit);
  const group = groups.find((names) => names.includes(joint.name));
  if (shown.value !== null || shown.limit !== null || group === undefined) return shown;
  return { ...shown, limit: text.estimate.tied(group.filter((name) => name !== joint.name)) };
}

/** Why joints are uncertain: one reason of one joint in a line, several behind a line. */
function Reasons({ of }: { of: Map<string, JointResult[]> }) {
  const rows = [...of].map(([reason, own]) => (
    <div class="reason soft" role="row">
      <span role="cell">
        <Name>{own.map(({ name }) => name).join(", ")}</Name>: <Prose text={reason} />
      </span>
    </div>
  ));
  const count = [...of.values()].flat().length;
  if (count < 2) return <>{rows}</>;
  return (
    <div role="row" class="reasons">
      <div role="cell">
        <details>
          <summary>{runWords.why(count)}</summary>
          <div role="table" aria-label={runWords.why(count)}>
            {rows}
          </div>
        </details>
      </div>
    </div>
  );
}

/** Whether the lamp says enough of a joint: its bar shows how well it is known, or its verdict is that of the run. */
const isPlain = (verdict: Verdict, cap: Usability | null, ofRun: Usability): boolean =>
  cap === null ? verdict === "firm" || verdict === "fair" : cap === ofRun;

/** Most letters of a name for which a phone has room in a line. */
const SHORT_NAME = 8;

/** Height of a row with its mark, and width of the longest share [px]. */
const [ROW, SHARE_WIDTH] = [40, 64];

interface FigureProps {
  title: string;
  /** Of the intervals. */
  level: string;
  series: { label: string; mark: string; joints: JointResult[] }[];
  tools?: preact.ComponentChildren;
}

/** Stiffnesses of several fits beside each other. */
export function StiffnessFigure({ title, level, series, tools }: FigureProps) {
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
