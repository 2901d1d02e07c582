/** One plan: its promise beside other plans', its certificate, and its check-list. */
import { api } from "../api/client";
import type { MeasurementSet, PlanRequest, PlanResult, Robot } from "../api/types";
import { Download, Button, Name, NameLink } from "../components/basics";
import { save } from "../components/download";
import { JobPage } from "../components/job_page";
import { DataTable } from "../components/table";
import { toFillIn } from "../lib/checklist";
import { fileName } from "../lib/csv";
import { percent, significant } from "../lib/format";
import { storedRobot, storedSet } from "../state/stored";
import { text } from "../i18n";
import { Checklist } from "./plan_checklist";

const words = text.plan;

type Promised = PlanResult["joints"][number];

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
        actions: job.result && (
          <Files {...{ plan: id, request: job.request, result: job.result, base, robot, subject }} />
        ),
      })}
    >
      {(result, { job, robot }) => (
        <>
          <Checklist plan={job} result={result} robot={robot} />
          <Promise result={result} />
        </>
      )}
    </JobPage>
  );
}

function Files({
  plan,
  request,
  result,
  base,
  robot,
  subject,
}: {
  plan: string;
  request: PlanRequest;
  result: PlanResult;
  base: MeasurementSet | null;
  robot: Robot;
  subject: string;
}) {
  const toMeasure = () => JSON.stringify(toFillIn(request, result.readings, robot.id, base), null, 1);
  return (
    <>
      <Button
        look="primary"
        onClick={() => save(toMeasure(), "application/json", fileName(`${subject} planned`, "json"))}
      >
        {words.fillIn}
      </Button>
      <Download href={api.plans.file(plan, "readings.csv")}>{words.csv}</Download>
    </>
  );
}

function Promise({ result }: { result: PlanResult }) {
  const nano = (value: number | null) => (value === null ? null : value * 1e9);
  const show = (value: number) => significant(value, 3);
  const struck = Object.entries(result.struck_out).map(
    ([reason, count]) => `${words.struck[reason] ?? reason} ${count}`,
  );
  const { columns, compliance: unit } = words;
  const all = [
    { column: text.run.joint, cell: (joint: Promised) => joint.name },
    { column: { title: columns.plan, unit, show }, cell: (joint: Promised) => nano(joint.standard_uncertainty) },
    {
      column: columns.relative,
      cell: (joint: Promised) => (joint.relative === null ? null : percent(joint.relative)),
    },
    { column: { title: columns.now, unit, show }, cell: (joint: Promised) => nano(joint.before) },
  ].filter(({ cell }) => result.joints.some((joint) => cell(joint) !== null)); // nothing is known to begin with
  return (
    <section class="card">
      <h2>{words.promised}</h2>
      <p class="note good">{words.certified(percent(result.efficiency), words.criteria[result.criterion])}</p>
      <DataTable
        caption={words.promised}
        table={{
          columns: all.map(({ column }) => column),
          rows: result.joints.map((joint) => all.map(({ cell }) => cell(joint))),
        }}
      />
      <p class="soft">
        {words.promisedNote}. {words.feasible(result.feasible, result.considered)}
        {struck.length > 0 && ` (${struck.join(", ")})`}. {result.elastic_links && words.links}{" "}
        {result.left_out.length > 0 && words.leftOut(result.left_out)}
      </p>
    </section>
  );
}
