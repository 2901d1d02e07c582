/** The page of a job of any kind: its head, then its progress, its problem, or what came of it. */
import type { ComponentChildren } from "preact";
import { api } from "../api/client";
import { type Collection, goesOn } from "../api/events";
import type { Assessment, Problem, Progress, RunState, Usability } from "../api/types";
import { fileName } from "../lib/csv";
import { VerdictCard } from "../views/verdict_card";
import { useDeletion } from "../state/action";
import { useLoad } from "../state/load";
import { copied } from "../state/toasts";
import { text } from "../i18n";
import { Badge, Download, ActionButton, Button, Head, Name, ProblemNote, Show, State, When } from "./basics";
import { save } from "./download";
import { Cancelled, Going } from "./going";

/** Kinds with a report for information; that of a run has a tab of its own, where it is signed. */
const REPORTED: readonly Collection[] = ["comparisons", "plans", "maps", "programs"];

/** Made from a run, whose verdict they carry. */
const CARRIED: readonly Collection[] = ["plans", "maps", "programs"];

export interface Job {
  id: string;
  state: RunState;
  progress: Progress | null;
  request: object;
  result: object | null;
  error: Problem | null;
  provenance: { created_at: string };
}

/** What the head of a page says of its job. */
interface About {
  /** Plain: in the browser's tab, and after the job was deleted. */
  name: string;
  /** The title, where it is more than the name. */
  title?: ComponentChildren;
  /** Links to what the job is about, and how it was asked for. */
  about?: ComponentChildren;
  /** Address of the list that it stands in. */
  list: string;
  /** What is to be done next. */
  first?: ComponentChildren;
  /** What else can be done with this kind of job. */
  actions?: ComponentChildren;
}

export function JobPage<Of extends Job, Context>({
  collection,
  id,
  kind,
  load,
  head,
  children,
}: {
  collection: Collection;
  id: string;
  /** Its word, above the title. */
  kind: string;
  /** The job, and what it is about. */
  load: (signal: AbortSignal) => Promise<{ job: Of } & Context>;
  head: (loaded: { job: Of } & Context) => About;
  /** What came of it. */
  children: (result: NonNullable<Of["result"]>, loaded: { job: Of } & Context, reload: () => void) => ComponentChildren;
}) {
  const loaded = useLoad(load, [id]);
  return (
    <Show of={loaded} title={kind}>
      {(found) => {
        const { job } = found;
        const { name, title, about, list, first, actions } = head(found);
        return (
          <>
            <Head
              kind={kind}
              plain={name}
              title={title ?? <Name>{name}</Name>}
              first={first}
              about={
                <>
                  <Standing job={job} />
                  {about}
                  <When time={job.provenance.created_at} />
                </>
              }
            >
              {actions}
              <Actions collection={collection} job={job} name={name} list={list} />
            </Head>
            {goesOn(job.state) && <Going job={job} ended={loaded.reload} />}
            {job.state === "cancelled" && <Cancelled progress={job.progress} />}
            {job.error && <ProblemNote problem={job.error} />}
            <Carried collection={collection} job={job} />
            {job.result && children(job.result, found, loaded.reload)}
          </>
        );
      }}
    </Show>
  );
}

/** The verdict on what came of it, or why nothing has. */
function Standing({ job }: { job: Job }) {
  const { assessment } = (job.result ?? {}) as { assessment?: Assessment | null };
  if (assessment) return <Badge verdict={assessment.verdict} />;
  return job.result || goesOn(job.state) ? null : <State state={job.state} />;
}

/** The verdict on what was made of a run, with its reasons; other results show their own themselves. */
function Carried({ collection, job }: { collection: Collection; job: Job }) {
  const { assessment } = (job.result ?? {}) as { assessment?: Assessment | null };
  if (!CARRIED.includes(collection) || !assessment || (assessment.verdict === "use" && !assessment.headline))
    return null;
  const { accept_verdict: accepted } = job.request as { accept_verdict?: Usability | null };
  return (
    <>
      <VerdictCard assessment={assessment} context={null} />
      {accepted === assessment.verdict && <p class="note warn">{text.assessment.despite}</p>}
    </>
  );
}

/** What can be done with any job: its link, its file, its report, its end. */
function Actions({ collection, job, name, list }: { collection: Collection; job: Job; name: string; list: string }) {
  const deletion = useDeletion({
    remove: () => api.jobs.delete(job.id),
    restore: () => api.jobs.restore(job.id),
    list,
    deleted: text.runs.deleted(name),
  });
  const kind = collection.replace(/ies$/, "y").replace(/s$/, "");
  const download = () => save(JSON.stringify(job, null, 2), "application/json", fileName(`${kind}-${job.id}`, "json"));
  return (
    <>
      {REPORTED.includes(collection) && job.result && (
        <Download href={api.jobs.file(job.id, "report.pdf")}>{text.run.report}</Download>
      )}
      <Button onClick={() => copied(location.href, text.run.share, text.run.shared)}>{text.run.share}</Button>
      <Button title={text.run.downloadHint} onClick={download}>
        {text.run.download}
      </Button>
      {!goesOn(job.state) && (
        <ActionButton look="quiet" action={deletion}>
          {text.run.delete}
        </ActionButton>
      )}
    </>
  );
}
