/** The joints of a run as one table and chart: stiffness on a logarithmic axis, in digits, its verdict, its part. */
import { Fragment } from "preact";
import type { Contribution, JointResult, Run, RunResult } from "../api/types";
import { StiffnessIntervals, type IntervalRow, RowAxis, RowMarks, intervalAxis, markOf } from "../charts/intervals";
import { Figure } from "../charts/figure";
import { Name, Prose, Term } from "../components/basics";
import { fixed, percent } from "../lib/format";
import { axisStiffness, shownStiffness } from "../lib/stiffness";
import { STIFFNESS_UNITS, type StiffnessUnit, unitOf } from "../lib/units";
import { capOf, verdictOf } from "../lib/verdict";
import { useWidth } from "../state/size";
import { useSettings } from "../state/settings";
import { text } from "../i18n";
import { NextMeasurement, useAdvice } from "./next_measurement";
import { type RunContext, isElastic } from "./run_context";

const words = text.run;

export function JointTable({
  context: { run, set, robot },
  result,
  beside,
  bare,
  tools,
}: {
  context: RunContext;
  result: RunResult;
  beside: Run | null;
  /** Without an axis: there is nothing to draw on it. */
  bare: boolean;
  tools: preact.ComponentChildren;
}) {
  const { unit } = useSettings();
  const positive = run.request.positive;
  const others = new Map(beside?.result?.joints.map((joint) => [joint.name, joint]));
  const rows: IntervalRow[] = result.joints.map((joint) => {
    const other = others.get(joint.name);
    return {
      name: joint.name,
      marks: [
        markOf(joint, positive ? "positive" : "free", unit),
        ...(other ? [markOf(other, positive ? "free" : "positive", unit)] : []),
      ],
    };
  });
  const legend = beside
    ? [
        { label: `${words.chosen}: ${words.other(positive)}`, mark: positive ? "positive" : "free" },
        { label: words.other(!positive), mark: positive ? "free" : "positive" },
      ]
    : [];
  const advice = useAdvice(robot, isElastic(run) ? [] : result.identifiability.advice);
  const chart = (width: number) => <StiffnessIntervals {...{ rows, width, unit, label: words.stiffness }} />;
  return (
    <Figure
      title={words.stiffness}
      {...(bare ? {} : { note: words.stiffnessNote(percent(run.request.confidence)) })}
      legend={legend}
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
    <div class={shares ? "joints shares" : bare ? "joints bare" : "joints"} role="table" aria-label={words.stiffness}>
      <div class={bare ? "joint-head hidden" : "joint-head"} role="row">
        <span role="columnheader">{words.joint}</span>
        <div role="columnheader" class="bar" ref={head}>
          {width > 0 && !bare && (
            <RowAxis axis={axis} width={width} format={format} label={STIFFNESS_UNITS[unit].label} />
          )}
        </div>
        <span role="columnheader" class="number">
          {words.quantity(unit === "compliance")} <small>{STIFFNESS_UNITS[unit].label}</small>
        </span>
        <span role="columnheader" class="number">
          <Term of="interval">{words.interval(level)}</Term>
        </span>
        <span role="columnheader">{words.verdict}</span>
        {shares && <span role="columnheader">{words.contribution}</span>}
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
    <Figure title={title} note={words.stiffnessNote(level)} legend={series} tools={tools}>
      {(width) => <StiffnessIntervals {...{ rows, width, unit, label: title }} />}
    </Figure>
  );
}
