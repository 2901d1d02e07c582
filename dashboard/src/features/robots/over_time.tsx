/** A robot over time: its trend with marks, what is measured now, and what was corrected last. */
import { api } from "../../api/calls";
import { queries } from "../../api/queries";
import type { Robot, Trend } from "../../api/types";
import { LinkButton } from "../../components/basics";
import { Rows } from "../../components/list";
import { link } from "../../state/action";
import { useQuery } from "../../state/query";
import { text } from "../../words";
import { OPEN } from "../measure/open_campaigns";
import { measureWords } from "../measure/words";
import { Marks, ReferenceChoice } from "../trend/history";
import { Timeline } from "../trend/timeline";
import { robotWords as words } from "./words";

/** The trend of the arm that was measured last, the campaign to compare with, and marks. */
export function OverTime({ robot, trend }: { robot: Robot; trend: Trend }) {
  const serial = trend.selection?.serial_number ?? null;
  return (
    <section class="card over-time" aria-label={words.overTime}>
      {trend.campaigns.length > 1 && (
        <>
          <Timeline trend={trend} marks={robot.marks} />
          <ReferenceChoice trend={trend} robot={robot} />
        </>
      )}
      <Marks robot={robot} serial={serial} />
      <LinkButton look="quiet" href={link(["compare", "trend", robot.id], serial === null ? {} : { serial })}>
        {words.allOfTrend}
      </LinkButton>
    </section>
  );
}

/** Campaigns of the robot that are still measured. */
export function MeasuredNow({ robot }: { robot: Robot }) {
  const { data: open } = useQuery(queries.sets({ ...OPEN, robot_id: robot.id }));
  if (!open || open.items.length === 0) return null;
  return (
    <section>
      <h2>{words.measuredNow}</h2>
      <Rows
        rows={open.items.map(({ id, name, observation_count: count }) => ({
          id,
          name,
          href: link(["measure", id]),
          how: measureWords.opened(count),
        }))}
      />
    </section>
  );
}

/** What was corrected last for the robot. */
export function LastCorrection({ robot }: { robot: Robot }) {
  const filters = { robot_id: robot.id, state: "succeeded", limit: 1 } as const;
  const { data: corrections } = useQuery({
    queryKey: ["corrections", filters],
    queryFn: ({ signal }) => api.corrections.list(filters, signal),
  });
  const [correction] = corrections?.items ?? [];
  if (!correction) return null;
  const name = correction.name ?? text.earlier.corrections;
  return (
    <section>
      <h2>{words.lastCorrection}</h2>
      <Rows
        rows={[{ id: correction.id, name, href: link(["corrections", correction.id]), at: correction.created_at }]}
      />
    </section>
  );
}
