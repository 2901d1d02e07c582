/** The page of a job of any kind: its head, then its progress, its problem, or what came of it, with its verdict. */
import { useEffect, useRef, useState } from "preact/hooks";
import { api, type Collection } from "../api/calls";
import { follow, goesOn, type Standing } from "../api/follow";
import { queries } from "../api/queries";
import type { AdvisedAction, Assessment, Finding, Run, Usability, Problem } from "../api/types";
import { roughTime, secondsLeft, type Mark } from "../lib/format";
import { useAction, link, useDeletion, copied } from "../state/action";
import { text } from "../words";
import {
  ActionButton,
  alikeOf,
  Busy,
  ProgressBar,
  Prose,
  Show,
  Badge,
  LinkButton,
  Seen,
  Download,
  Button,
  Head,
  Name,
  ProblemNote,
  State,
  When,
} from "./basics";
import { onPage, firstSentence, sentence } from "../lib/said";
import { STIFFNESS_UNITS } from "../lib/stiffness";
import { useQuery } from "../state/query";
import { useSettings } from "../state/session";
import { StatePayload } from "./state_payload";
import { tableOf } from "./shown_table";
import { TableCard, fileName, saveJson } from "./table";
import type { RunContext } from "../state/run_context";
import type { ComponentChildren } from "preact";

const LOOK_MS = 5_000;

export function Going({ job, ended }: { job: Standing; ended: () => void }) {
  const [standing, set] = useState<Standing>(job);
  const [away, setAway] = useState(false);
  useEffect(() => follow(job.id, (now, end) => (end ? ended() : set(now)), setAway), [job.id]);
  const alone = useNoWorker(standing.progress?.done ?? 0);
  const waits = standing.progress?.waits;
  const stuck = away ? text.run.away : alone ? text.run.noWorker : waits ? sentence(waits) : null;
  const stop = useAction(() => api.jobs.cancel(job.id));
  return (
    <section class="card going" aria-live="polite">
      <Busy label={text.states[standing.state]} />
      <Bar standing={standing} />
      {stuck ? (
        <p class="note" role="alert">
          {stuck}
        </p>
      ) : (
        <>
          <Left standing={standing} />
          <p>{text.run.started}</p>
        </>
      )}
      <ActionButton action={stop} going={text.run.cancelling}>
        {text.run.cancel}
      </ActionButton>
    </section>
  );
}

/** The progress of something long. */
export function Bar({ standing: { progress } }: { standing: Standing }) {
  if (!progress || progress.total <= 0) return <ProgressBar />;
  if (progress.done >= progress.total) return <ProgressBar>{text.run.finishing}</ProgressBar>;
  return <ProgressBar {...progress}>{`${text.run.progressOf(progress)}: ${progress.activity}`}</ProgressBar>;
}

/** Whether the service has no worker; it is only asked while nothing moves. */
function useNoWorker(done: number): boolean {
  const [asks, ask] = useState(false);
  useEffect(() => {
    ask(false);
    const timer = setTimeout(() => ask(true), LOOK_MS);
    return () => clearTimeout(timer);
  }, [done]);
  const { data } = useQuery({ ...queries.health, enabled: asks, refetchInterval: LOOK_MS });
  return asks && data?.workers === 0;
}

function Left({ standing: { progress } }: { standing: Standing }) {
  const first = useRef<Mark | null>(null);
  if (!progress || progress.done >= progress.total) return null;
  const now = { done: progress.done, at: performance.now() };
  first.current ??= now;
  if (now.done < first.current.done) first.current = now; // it began anew
  const seconds = secondsLeft(first.current, now, progress.total);
  return <p class="soft">{seconds === null ? text.run.leftUnknown : text.run.left(roughTime(seconds))}</p>;
}

function useTables(collection: Collection, id: string) {
  const unit = STIFFNESS_UNITS[useSettings().unit].name;
  return useQuery(queries.tables(id, { unit, details: String(collection !== "comparisons") }));
}

interface JobTablesProps {
  collection: Collection;
  id: string;
  /** The first one shown, and the first one not shown. */
  from?: number;
  to?: number | undefined;
}

export function JobTables({ collection, id, from = 0, to }: JobTablesProps) {
  return (
    <Show of={useTables(collection, id)}>
      {({ tables }) =>
        tables
          .slice(from, to)
          .map((table) => (
            <TableCard title={table.title || (table.head[1] ?? "")} note={table.caption} table={tableOf(table)} />
          ))
      }
    </Show>
  );
}

interface JobLinesProps {
  collection: Collection;
  id: string;
  of?: "lines" | "evidence";
}

/** What the service says of a job in lines: of its result, or of the evidence for it. */
export const JobLines = ({ collection, id, of = "lines" }: JobLinesProps) => (
  <Show of={useTables(collection, id)}>
    {(said) => (
      <ul class="lines">
        {said[of].map((line) => (
          <li>
            <Prose text={sentence(line)} />
          </li>
        ))}
      </ul>
    )}
  </Show>
);

const words = text.assessment;

interface VerdictCardProps {
  assessment: Assessment;
  context: RunContext | null;
  /** What each verdict means, where it is not about stiffnesses. */
  sentences?: Record<Usability, string>;
  /** The run that it was made from: its reasons are said there, once. */
  of?: Run | null | undefined;
}

/** What a person knows and the readings do not show, such as the payload. */
export const questionsOf = ({ questions }: Assessment): Finding[] => questions ?? [];

export function VerdictCard({ assessment, context, sentences = words.sentence, of }: VerdictCardProps) {
  const ofRun = of?.result?.assessment.reasons ?? [];
  const isOfRun = ({ code, message }: Finding) => ofRun.some((one) => one.code === code && one.message === message);
  const reasons = assessment.reasons.filter((reason) => !isOfRun(reason));
  return (
    <section class={`verdict-card ${assessment.verdict}`} aria-label={words.title}>
      <VerdictLine assessment={assessment} sentences={sentences} />
      <Reasons assessment={{ ...assessment, reasons: [...reasons, ...questionsOf(assessment)] }} context={context} />
      {of && reasons.length < assessment.reasons.length && (
        <LinkButton href={link(["runs", of.id])}>{words.onRun(assessment.reasons.length - reasons.length)}</LinkButton>
      )}
      <Notes notes={assessment.notes} />
    </section>
  );
}

/** The verdict in one sentence. */
export function VerdictLine({ assessment, sentences = words.sentence }: Omit<VerdictCardProps, "context">) {
  const { verdict, headline, joints_identified: identified, joint_count: count } = assessment;
  const counted = identified != null && count != null;
  return (
    <h2>
      <Badge verdict={verdict} large />
      <span>
        {headline ?? (counted && verdict === "use" ? words.supported(identified, count) : sentences[verdict])}
        {counted && verdict !== "use" && !headline && <b> {words.identified(identified, count)}</b>}
      </span>
    </h2>
  );
}

interface ReasonsProps extends Omit<VerdictCardProps, "sentences"> {
  /** A line for each kind; the rest is behind it. */
  brief?: boolean;
}

/** Why the verdict is what it is, and what to do about it. */
export const Reasons = ({ assessment: { reasons }, context, brief = false }: ReasonsProps) =>
  reasons.length === 0 ? null : (
    <ul class={brief ? "brief" : undefined}>
      {offeredOnce(alikeOf(reasons)).map((group) => (
        <ReasonItem reasons={group} context={context} brief={brief} />
      ))}
    </ul>
  );

/** The same reasons, each action with the first reason that it removes. */
function offeredOnce(groups: Finding[][]): Finding[][] {
  const offered = new Set<string>();
  return groups.map((group) => {
    const before = new Set(offered);
    return group.map((reason) => {
      const key = JSON.stringify(reason.action);
      offered.add(key);
      return before.has(key) ? { ...reason, action: null } : reason;
    });
  });
}

export const Notes = ({ notes }: { notes: string[] }) => (
  <>
    {notes.map((note) => (
      <p class="note">
        <Prose text={onPage(note)} />
      </p>
    ))}
  </>
);

function ReasonItem({ reasons, context, brief }: { reasons: Finding[]; context: RunContext | null; brief: boolean }) {
  const [first] = reasons;
  if (!first) return null;
  const [begun, rest] = firstSentence(first.message);
  const actions = new Map(reasons.flatMap(({ action }) => (action ? [[JSON.stringify(action), action] as const] : [])));
  const remedy = (
    <p class="remedy">
      <Prose text={sentence(first.remedy)} />
    </p>
  );
  return (
    <li class={first.weight}>
      {brief ? (
        <details>
          <summary>
            <Seen warning={{ ...first, message: begun }} />
          </summary>
          {rest && (
            <p>
              <Prose text={rest} />
            </p>
          )}
          {reasons.slice(1).map((reason) => (
            <Seen warning={reason} />
          ))}
          {remedy}
        </details>
      ) : (
        <div>
          {reasons.map((reason) => (
            <Seen warning={reason} />
          ))}
          {remedy}
        </div>
      )}
      {context && actions.size > 0 && (
        <div class="actions">
          {[...actions.values()].map((action) => (
            <ActionButtons action={action} context={context} />
          ))}
        </div>
      )}
    </li>
  );
}

/** What the action does, and where it is about postures, one to look at it first. */
function ActionButtons({ action, context }: { action: AdvisedAction; context: RunContext }) {
  const start = useAction(async () => {
    const run = await variantBy(context.run, action);
    return link(["runs", run.id]);
  });
  const [shown] = action.observations;
  if (action.kind === "state_payload") return <StatePayload action={action} run={context.run} />;
  return (
    <>
      {action.kind !== "show_posture" && (
        <ActionButton action={start} going={text.start.going}>
          {words.actions[action.kind](action)}
        </ActionButton>
      )}
      {shown !== undefined && (
        <LinkButton look="quiet" href={link(["runs", context.run.id, "robot"], { at: shown, from: "result" })}>
          {words.show(shown)}
        </LinkButton>
      )}
    </>
  );
}

/** Carry out an action; pressed twice it gives the same run. */
export const variantBy = (run: Run, action: AdvisedAction): Promise<Run> => api.apply(run.id, action);

/** Kinds with a report for information; that of a run has a tab of its own, where it is signed. */
const REPORTED: readonly Collection[] = ["comparisons", "plans", "maps", "corrections"];

/** Made from a run, whose verdict they carry. */
const CARRIED: readonly Collection[] = ["plans", "maps", "corrections"];

export interface PageJob extends Standing {
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
  /** The run that it was made from. */
  run?: Run | null;
  /** What is to be done next. */
  first?: ComponentChildren;
  /** What else can be done with this kind of job. */
  actions?: ComponentChildren;
}

export function JobPage<Of extends PageJob, Context>({
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
  const loaded = useQuery({
    queryKey: ["job", collection, id],
    queryFn: ({ signal }) => load(signal),
    staleTime: ({ state }) => (state.data && !goesOn(state.data.job.state) ? Number.POSITIVE_INFINITY : 0),
  });
  return (
    <Show of={loaded} title={kind} restore={() => api.jobs.restore(id)}>
      {(found) => {
        const { job } = found;
        const { name, title, about, list, run, first, actions } = head(found);
        return (
          <>
            <Head
              kind={kind}
              plain={name}
              {...(collection === "runs" ? { fold: "all" } : {})}
              title={title ?? <Name>{name}</Name>}
              first={first}
              about={
                <>
                  <VerdictOrState job={job} />
                  {about}
                  <When time={job.provenance.created_at} />
                </>
              }
            >
              {actions}
              <Actions collection={collection} job={job} name={name} list={list} />
            </Head>
            {goesOn(job.state) && <Going job={job} ended={loaded.refetch} />}
            {job.state === "cancelled" && (
              <p class="note">
                {text.run.cancelled}
                {job.progress && ` ${text.run.cameTo(text.run.progressOf(job.progress))}`}
              </p>
            )}
            {job.error && <ProblemNote problem={job.error} />}
            <Carried collection={collection} job={job} run={run} />
            {job.result && children(job.result, found, loaded.refetch)}
          </>
        );
      }}
    </Show>
  );
}

/** The verdict on what came of it, or why nothing has. */
function VerdictOrState({ job }: { job: PageJob }) {
  const { assessment } = (job.result ?? {}) as { assessment?: Assessment | null };
  if (assessment) return <Badge verdict={assessment.verdict} />;
  return job.result || goesOn(job.state) ? null : <State state={job.state} />;
}

interface CarriedProps {
  collection: Collection;
  job: PageJob;
  run: Run | null | undefined;
}

/** The verdict on what was made of a run, with its own reasons; other results show theirs themselves. */
function Carried({ collection, job, run }: CarriedProps) {
  const { assessment } = (job.result ?? {}) as { assessment?: Assessment | null };
  if (!CARRIED.includes(collection) || !assessment || (assessment.verdict === "use" && !assessment.headline))
    return null;
  const { accept_verdict: accepted } = job.request as { accept_verdict?: Usability | null };
  return (
    <>
      <VerdictCard assessment={assessment} context={null} of={run} />
      {accepted === assessment.verdict && <p class="note warn">{text.assessment.despite}</p>}
    </>
  );
}

interface ActionsProps {
  collection: Collection;
  job: PageJob;
  name: string;
  list: string;
}

/** What can be done with any job: its link, its file, its report, its end. */
function Actions({ collection, job, name, list }: ActionsProps) {
  const deletion = useDeletion({
    remove: () => api.jobs.delete(job.id),
    restore: () => api.jobs.restore(job.id),
    list,
    deleted: text.deletion.done(name),
  });
  const kind = collection.replace(/ies$/, "y").replace(/s$/, "");
  const download = () => saveJson(job, fileName(`${kind}-${job.id}`, "json"));
  return (
    <>
      {REPORTED.includes(collection) && job.result && (
        <Download href={api.jobs.file(job.id, "report.pdf")}>{text.run.views.report}</Download>
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
