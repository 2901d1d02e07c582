/** The stiffness of a robot today: each joint by its last campaign, and how it changed since the first. */
import { queries } from "../../api/queries";
import type { Robot, Trend } from "../../api/types";
import { Badge, Busy, Name, When } from "../../components/basics";
import { Estimate } from "../../components/estimate";
import { dayText } from "../../lib/format";
import { labelOf, shownStiffness } from "../../lib/stiffness";
import { link } from "../../state/action";
import { useQuery } from "../../state/query";
import { useSettings } from "../../state/session";
import { changeText, firstCompared } from "../trend/trend";
import { robotWords as words } from "./words";

export function Today({ robot, last }: { robot: Robot; last: NonNullable<Robot["last_campaign"]> }) {
  const { unit } = useSettings();
  const { data: run } = useQuery(queries.run(last.run_id));
  const { data: trend } = useQuery(queries.trend(robot.id, { serial_number: last.serial_number }));
  const kinds = robot.joints.map(({ kind }) => kind ?? "revolute");
  return (
    <section class="card today" aria-label={words.today}>
      <h2>
        {words.today} <small class="soft">{labelOf(unit, kinds)}</small>
      </h2>
      <p class="meta">
        <Badge verdict={last.verdict} />
        <When time={last.at} />
        <a href={link(["runs", last.run_id])}>{words.itsRun}</a>
      </p>
      {run?.result ? (
        <ul>
          {run.result.joints.map((joint) => (
            <li>
              <b>
                <Name>{joint.name}</Name>
              </b>
              <Estimate of={shownStiffness(joint, unit)} />
              <Changed joint={joint.name} trend={trend} />
            </li>
          ))}
        </ul>
      ) : (
        <Busy />
      )}
    </section>
  );
}

/** The change of a joint in words, since when; nothing where it cannot be told from chance. */
function Changed({ joint: name, trend }: { joint: string; trend: Trend | undefined }) {
  const joint = trend?.joints.find((one) => one.name === name);
  if (!trend || !joint?.changed || !joint.change) return null;
  return (
    <small class="bad">
      {changeText(joint.change)} {words.since(dayText(trend.campaigns[firstCompared(joint)]?.at ?? ""))}
    </small>
  );
}
