/** The fleet: the wall of all robots; all of them identified again, and what came of each. */
import { api } from "../../api/calls";
import { freshKey } from "../../lib/json";
import { ActionButton, Badge, Download, NameLink, Title } from "../../components/basics";
import { Estimate } from "../../components/estimate";
import { DataTable, type Table } from "../../components/table";
import { labelOf, shownWithInterval } from "../../lib/stiffness";
import { SETS, setsToldApart } from "../../state/choices";
import { useQuery } from "../../state/query";
import { useSettings } from "../../state/session";
import { queries } from "../../api/queries";
import type { FleetRow } from "../../api/types";
import { Wall } from "./wall";
import { JobLines, JobPage } from "../../components/job_page";
import { text } from "../../words";
import { link, useAction } from "../../state/action";
import { RobotTabs } from "../robots/view";
import { JobList } from "../runs/view";
import { fleetWords } from "./words";

const words = fleetWords;

export function FleetsView() {
  const start = useAction(async () => link(["fleets", (await api.fleets.add({}, freshKey("fleet"))).id]));
  return (
    <>
      <Title plain={words.title}>{words.title}</Title>
      <RobotTabs current="fleets" />
      <Wall />
      <section class="card">
        <h2>{words.again}</h2>
        <p>{words.intro}</p>
        <ActionButton action={start} going={words.going}>
          {words.start}
        </ActionButton>
      </section>
      <JobList collection="fleets" />
    </>
  );
}

export function FleetView({ id }: { id: string }) {
  return (
    <JobPage
      collection="fleets"
      id={id}
      kind={text.earlier.fleet}
      load={async (signal) => ({ job: await api.fleets.one(id, signal) })}
      head={({ job }) => ({
        name: job.request.name ?? text.earlier.fleet,
        list: "#/fleets",
        actions: job.result && <Download href={api.jobs.file(id, "table.csv")}>{words.csv}</Download>,
      })}
    >
      {({ rows }) => (
        <>
          <JobLines collection="fleets" id={id} />
          <FleetTable rows={rows} />
        </>
      )}
    </JobPage>
  );
}

/** The sets of a fleet with the stiffness of each joint; dates tell sets of equal names apart. */
function FleetTable({ rows }: { rows: FleetRow[] }) {
  const { unit } = useSettings();
  const sets = useQuery(queries.sets(SETS)).data?.items ?? [];
  const names = setsToldApart(sets.filter(({ id }) => rows.some((row) => row.measurement_set_id === id)));
  const joints = [...new Set(rows.flatMap(({ stiffness }) => Object.keys(stiffness)))];
  const kinds = [...new Set(rows.flatMap(({ joint_kinds: kinds }) => Object.values(kinds ?? {})))];
  const cell = (row: FleetRow, joint: string) => {
    const kind = row.joint_kinds?.[joint];
    const shown = shownWithInterval(row.stiffness[joint] ?? null, row.stiffness_interval[joint] ?? null, unit, kind);
    return <Estimate of={{ ...shown, unusable: row.verdict === "do_not_use" }} />;
  };
  const table: Table = {
    columns: [words.set, text.start.robot, text.run.verdict, ...joints],
    rows: rows.map((row) => [
      <NameLink to={["sets", row.measurement_set_id]}>
        {names.get(row.measurement_set_id) ?? row.measurement_set_name}
      </NameLink>,
      <NameLink to={["robots", row.robot_id]}>{row.robot_name}</NameLink>,
      row.verdict ? <Badge verdict={row.verdict} /> : (row.error?.detail ?? ""),
      ...joints.map((joint) => cell(row, joint)),
    ]),
  };
  return (
    <section class="card fleet">
      <h2>{words.sets}</h2>
      <p class="soft">{words.unit(labelOf(unit, kinds))}</p>
      <DataTable table={table} caption={words.sets} />
    </section>
  );
}
