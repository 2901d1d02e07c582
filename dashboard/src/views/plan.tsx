/** One plan: its promise beside other plans', its certificate, and its postures. */
import { api } from "../api/client";
import { Download, Button, LinkButton, Name, NameLink } from "../components/basics";
import { save } from "../components/download";
import { JobPage } from "../components/job_page";
import { JobTables } from "../components/job_tables";
import { toFillIn } from "../lib/planned";
import { fileName } from "../lib/csv";
import { percent } from "../lib/format";
import { link } from "../state/router";
import { storedRobot, storedSet } from "../state/names";
import { later } from "../i18n/later";
import { Postures } from "./plan_postures";

const words = later.plan;

export function PlanView({ id }: { id: string }) {
  return (
    <JobPage
      collection="plans"
      id={id}
      kind={words.kind}
      load={async (signal) => {
        const plan = await api.plans.one(id, signal);
        const setId = plan.request.measurement_set_id;
        const base = setId ? await storedSet(setId) : null;
        const robot = await storedRobot(base?.robot_id ?? plan.request.robot_id ?? "");
        return { job: plan, base, robot, subject: base?.name ?? robot.name };
      }}
      head={({ job, base, robot, subject }) => ({
        name: words.title(subject),
        title: <Name>{subject}</Name>,
        list: "#/plans",
        about: <NameLink to={base ? ["sets", base.id] : ["robots", robot.id]}>{subject}</NameLink>,
        first: job.result && (
          <>
            <LinkButton look="primary" href={link(["measure"], { plan: id })}>
              {later.measure.title}
            </LinkButton>
            <Button
              onClick={() => {
                const campaign = toFillIn(job.request, job.result?.readings ?? [], robot.id, base);
                save(JSON.stringify(campaign, null, 1), "application/json", fileName(`${subject} planned`, "json"));
              }}
            >
              {words.fillIn}
            </Button>
          </>
        ),
        actions: job.result && <Download href={api.jobs.file(id, "readings.csv")}>{words.csv}</Download>,
      })}
    >
      {(result, { job, robot }) => {
        const struck = Object.entries(result.struck_out).map(
          ([reason, count]) => `${words.struck[reason] ?? reason} ${count}`,
        );
        return (
          <>
            <Postures plan={job} result={result} robot={robot} />
            <p class="note good">{words.certified(percent(result.efficiency), words.criteria[result.criterion])}</p>
            <JobTables collection="plans" id={id} to={1} />
            <p class="soft">
              {words.feasible(result.feasible, result.considered)}
              {struck.length > 0 && ` (${struck.join(", ")})`}. {result.elastic_links && words.links}{" "}
              {result.left_out.length > 0 && words.leftOut(result.left_out)}
            </p>
          </>
        );
      }}
    </JobPage>
  );
}
