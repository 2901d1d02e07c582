/** The stiffness of a robot today: what its last campaign says in a sentence, each joint, and how it changed. */
import { queries } from "../../api/queries";
import type { MeasurementSet, Robot, RunResult, Trend } from "../../api/types";
import { Badge, Busy, Name, When } from "../../components/basics";
import { Estimate } from "../../components/estimate";
import { factsOf } from "../../lib/campaign";
import { shownChange } from "../../lib/estimate";
import { dayText, extent, fixed } from "../../lib/format";
import { labelOf, shownStiffness } from "../../lib/stiffness";
import { norm } from "../../lib/vector";
import { link } from "../../state/action";
import { useQuery } from "../../state/query";
import { useSettings } from "../../state/session";
import { text } from "../../words";
import { changeText, firstCompared } from "../trend/trend";
import { robotWords as words } from "./words";

type Last = NonNullable<Robot["last_campaign"]>;

interface TodayProps {
  robot: Robot;
  last: Last;
  trend: Trend | undefined;
  /** Whether the trend is known, or that there is none. */
  known: boolean;
}

export function Today({ robot, last, trend, known }: TodayProps) {
  const { unit } = useSettings();
  const { data: run } = useQuery(queries.run(last.run_id));
  const setId = run?.request.measurement_set_id ?? "";
  const { data: set } = useQuery({ ...queries.set(setId), enabled: setId !== "" });
  const kinds = robot.joints.map(({ kind }) => kind ?? "revolute");
  return (
    <section class="card today" aria-label={words.today}>
      <h2>{words.today}</h2>
      <p class="meta">
        <Badge verdict={last.verdict} />
        <When time={last.at} />
        <a href={link(["runs", last.run_id])}>{words.itsRun}</a>
      </p>
      {run?.result && set && known ? (
        <>
          <p class="sentence">
            {movedText(run.result, set)} <Worst trend={trend} />
          </p>
          <div role="table" aria-label={words.today}>
            <div role="row" class="soft">
              <span role="columnheader">{text.run.joint}</span>
              <span role="columnheader">{labelOf(unit, kinds)}</span>
              <span role="columnheader">{words.change}</span>
            </div>
            {run.result.joints.map((joint) => (
              <div role="row">
                <span role="rowheader">
                  <Name>{joint.name}</Name>
                </span>
                <span role="cell">
                  <Estimate of={shownStiffness(joint, unit)} />
                </span>
                <span role="cell">
                  <Changed joint={joint.name} trend={trend} />
                </span>
              </div>
            ))}
          </div>
        </>
      ) : (
        <Busy />
      )}
    </section>
  );
}

/** Lengths in mm: their mean, and the least and greatest. */
function lengthsText(lengths: number[]): string {
  const mean = (1e3 * lengths.reduce((sum, length) => sum + length, 0)) / lengths.length;
  const [low, high] = (extent(lengths) ?? [0, 0]).map((length) => 1e3 * length) as [number, number];
  const decimals = mean < 0.1 ? 3 : 2;
  const show = (value: number) => fixed(value, decimals);
  return `${show(mean)}\u00a0${text.units.mm} (${show(low)}\u00a0…\u00a0${show(high)}\u00a0${text.units.mm})`;
}

/** How far the measured points gave way, at which force, and what the joints leave unexplained. */
function movedText({ residuals, assessment }: RunResult, set: MeasurementSet): string | null {
  const moved = residuals.map(({ deflection }) => norm(deflection));
  if (moved.length === 0) return null;
  const left = residuals.map(({ residual }) => norm(residual));
  const force = factsOf(set as never).forces?.[1];
  const at = force ? `${fixed(force, 0)}\u00a0${text.units.newton}` : null;
  const after = assessment.verdict === "do_not_use" ? null : lengthsText(left);
  return words.moved(lengthsText(moved), at, after);
}

/** The joint that changed most certainly, and since when; that nothing changed, if that was tested. */
function Worst({ trend }: { trend: Trend | undefined }) {
  const tested = trend?.joints.filter(({ change }) => change) ?? [];
  const changed = tested.filter((joint) => joint.changed);
  const sizeOf = ({ change }: Trend["joints"][number]) =>
    change ? -Math.sign(change.value) * 1e6 + Math.abs(change.value) / (change.standard_uncertainty ?? 1) : 0;
  const [worst] = [...changed].sort((a, b) => sizeOf(b) - sizeOf(a));
  if (!trend || trend.campaigns.length < 2) return <span class="soft">{words.oneCampaign}</span>;
  if (!worst?.change) return <span>{tested.length > 0 ? words.unchanged(tested.length) : words.noneTested}</span>;
  const since = dayText(trend.campaigns[firstCompared(trend, worst)]?.at ?? "");
  return (
    <span class="bad">
      <Name>{worst.name}</Name> {words.changedBy(worst.change.value < 0, changeText(worst.change), since)}
      {changed.length > 1 && ` ${words.further(changed.length - 1)}`}
    </span>
  );
}

/** The change of a joint with its interval, since when if it is beyond chance; that it was not tested, if it was not. */
function Changed({ joint: name, trend }: { joint: string; trend: Trend | undefined }) {
  const joint = trend?.joints.find((one) => one.name === name);
  if (!trend) return null;
  if (!joint?.change || joint.p_value === null) return <small class="soft">{words.untested}</small>;
  const change = (
    <Estimate of={shownChange(joint.change.value, joint.change.standard_uncertainty)} unit={text.units.share} bare />
  );
  if (!joint.changed) return <small class="soft">{change}</small>;
  return (
    <small class="bad">
      {change} {words.since(dayText(trend.campaigns[firstCompared(trend, joint)]?.at ?? ""))}
    </small>
  );
}
