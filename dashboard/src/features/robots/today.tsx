/** The stiffness of a robot today: each joint by its last campaign, and how it changed since the first. */
import { queries } from "../../api/queries";
import type { Robot, Trend } from "../../api/types";
import { Badge, Busy, Name, When } from "../../components/basics";
import { Estimate } from "../../components/estimate";
import { shownChange } from "../../lib/estimate";
import { dayText } from "../../lib/format";
import { labelOf, shownStiffness } from "../../lib/stiffness";
import { link } from "../../state/action";
import { useQuery } from "../../state/query";
import { useSettings } from "../../state/session";
import { firstCompared } from "../trend/trend";
import { text } from "../../words";
import { robotWords as words } from "./words";

export function Today({ robot, last }: { robot: Robot; last: NonNullable<Robot["last_campaign"]> }) {
  const { unit } = useSettings();
  const { data: run } = useQuery(queries.run(last.run_id));
  const { data: trend, problem } = useQuery(queries.trend(robot.id, { serial_number: last.serial_number }));
  const kinds = robot.joints.map(({ kind }) => kind ?? "revolute");
  return (
    <section class="card today" aria-label={words.today}>
      <h2>{words.today}</h2>
      <p class="meta">
        <Badge verdict={last.verdict} />
        <When time={last.at} />
        <a href={link(["runs", last.run_id])}>{words.itsRun}</a>
      </p>
      {run?.result && (trend || problem) ? (
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
      ) : (
        <Busy />
      )}
    </section>
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
      {change} {words.since(dayText(trend.campaigns[firstCompared(joint)]?.at ?? ""))}
    </small>
  );
}
