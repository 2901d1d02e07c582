/** Fleets: all robots identified again, and what came of each. */
import { api } from "../../api/calls";
import { freshKey } from "../../lib/json";
import { ActionButton, Download, Title } from "../../components/basics";
import { JobLines, JobPage, JobTables } from "../../components/job_page";
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
      <p>{words.intro}</p>
      <p>
        <ActionButton look="primary" action={start} going={words.going}>
          {words.start}
        </ActionButton>
      </p>
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
      {() => (
        <>
          <JobLines collection="fleets" id={id} />
          <JobTables collection="fleets" id={id} />
        </>
      )}
    </JobPage>
  );
}
