/** Each joint of one robot over its campaigns: charts with intervals, and whether the latest differs from the first. */
import { useState } from "preact/hooks";
import { queries } from "../../api/queries";
import type { Method, Robot, Trend as Found } from "../../api/types";
import { Badge, Empty, Head, MeasureLink, Name, Show, Toggle } from "../../components/basics";
import { Select } from "../../components/fields";
import { Rows } from "../../components/list";
import { go, link } from "../../state/action";
import { useQuery } from "../../state/query";
import { text } from "../../words";
import { compareWords } from "../compare/words";
import { Marks, ReferenceChoice } from "./history";
import { ChangedLines, TestsOfJoints, Timeline } from "./timeline";
import { trendWords } from "./words";

const words = trendWords;

interface Asked {
  method?: Method;
  encoders?: NonNullable<Found["selection"]>["encoders"];
}

export function TrendView({ robot: id, serial }: { robot: string; serial: string | null }) {
  const [asked, setAsked] = useState<Asked>({});
  const [sameLoad, setSameLoad] = useState(false);
  const [sameCell, setSameCell] = useState(false);
  const shared = {
    ...(sameLoad && { same_load: "true" }),
    ...(sameCell && { same_cell: "true" }),
  };
  const trend = useQuery({
    ...queries.trend(id, { ...asked, ...shared, serial_number: serial }),
    placeholderData: (earlier: Found | undefined) => (earlier?.robot_id === id ? earlier : undefined),
  });
  const robot = useQuery(queries.robot(id));
  const name = robot.data?.name ?? "…";
  return (
    <>
      <Head
        kind={compareWords.trend}
        plain={words.title(name)}
        title={<Name>{name}</Name>}
        about={
          <>
            <a href={link(["robots", id])}>{text.start.robot}</a>
          </>
        }
      />
      <Show of={robot}>
        {(arm) => (
          <Show of={trend}>
            {(found) => (
              <>
                <div class="filters compact">
                  <Select
                    label={text.run.method}
                    value={asked.method ?? found.selection?.method ?? "partial_pose"}
                    change={(method) => setAsked({ ...asked, method: method as Method })}
                    options={text.methods}
                  />
                  <Select
                    label={words.encoders}
                    value={asked.encoders ?? found.selection?.encoders ?? "motor"}
                    change={(encoders) => setAsked({ ...asked, encoders: encoders as "motor" })}
                    options={text.files.encoders}
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
                <Charts trend={found} robot={arm} />
                {found.left_out.length > 0 && (
                  <details>
                    <summary>{words.leftOut(found.left_out.length)}</summary>
                    <Rows
                      rows={found.left_out.map(({ measurement_set_id: set, name, reason }) => ({
                        id: set,
                        href: link(["sets", set]),
                        name,
                        how: reason,
                      }))}
                    />
                  </details>
                )}
                <Toggle label={compareWords.sameLoad} checked={sameLoad} change={setSameLoad} />
                <Toggle label={compareWords.sameCell} checked={sameCell} change={setSameCell} />
              </>
            )}
          </Show>
        )}
      </Show>
    </>
  );
}

/** The serial numbers of the robot's sets, and that the chart shown is of sets without one. */
const serialsOf = ({ selection, serial_numbers: serials }: Found) => [
  ...(selection?.serial_number ? [] : [{ value: "", label: words.noSerial }]),
  ...serials.map((value) => ({ value, label: value })),
];

function Charts({ trend, robot }: { trend: Found; robot: Robot }) {
  if (trend.campaigns.length === 0)
    return (
      <Empty title={words.none} hint={words.noneHint}>
        <MeasureLink robot={trend.robot_id} />
      </Empty>
    );
  return (
    <>
      <ChangedLines trend={trend} />
      {trend.note !== null && <p class="note warn">{words.said(trend.note)}</p>}
      <ReferenceChoice trend={trend} robot={robot} />
      <Timeline trend={trend} marks={robot.marks} />
      <p class="hint">
        {trend.campaigns.length > 1 && words.test(trend.level)}
        {words.axes}
      </p>
      <details open={trend.joints.some(({ changed }) => changed)}>
        <summary>{words.tests}</summary>
        <TestsOfJoints trend={trend} />
      </details>
      <Marks robot={robot} serial={trend.selection?.serial_number ?? null} />
      <details open={trend.campaigns.some(({ verdict }) => verdict !== "use")}>
        <summary>{words.campaigns(trend.campaigns.length, trend.campaign_count)}</summary>
        <Rows
          rows={trend.campaigns.map(({ run_id: id, name, at, verdict }) => ({
            id,
            href: link(["runs", id]),
            name,
            at,
            standing: <Badge verdict={verdict} />,
          }))}
        />
      </details>
    </>
  );
}
