/** Something that takes long: how far it is, how long it will take, whether the service is there, and how to end it. */
import { useEffect, useRef, useState } from "preact/hooks";
import { api } from "../api/client";
import { follow, type Standing } from "../api/events";
import type { Progress, RunState } from "../api/types";
import { roughTime, secondsLeft, type Mark } from "../lib/progress";
import { useAction } from "../state/action";
import { text } from "../i18n";
import { ActionButton, Busy } from "./basics";

const LOOK_MS = 5_000;

interface Job {
  id: string;
  state: RunState;
  progress?: Progress | null;
}

export function Going({ job, ended }: { job: Job; ended: () => void }) {
  const [standing, set] = useState<Standing>({ id: job.id, state: job.state, progress: job.progress ?? null });
  const [away, setAway] = useState(false);
  useEffect(() => follow(job.id, (now, end) => (end ? ended() : set(now)), setAway), [job.id]);
  const alone = useNoWorker(standing.progress?.done ?? 0);
  const stuck = away ? text.run.away : alone ? text.run.noWorker : null;
  const stop = useAction(() => api.jobs.cancel(job.id));
  return (
    <section class="card going" aria-live="polite">
      <Busy label={text.states[standing.state]} />
      <Bar standing={standing} />
      {!stuck && <Left standing={standing} />}
      {stuck ? (
        <p class="note" role="alert">
          {stuck}
        </p>
      ) : (
        <p>{text.run.started}</p>
      )}
      <ActionButton action={stop} going={text.run.cancelling}>
        {text.run.cancel}
      </ActionButton>
    </section>
  );
}

/** The progress of something long. */
export function Bar({ standing: { progress } }: { standing: Standing }) {
  if (!progress || progress.total <= 0) return <progress aria-label={text.run.progress} />;
  if (progress.done >= progress.total)
    return (
      <span class="progress">
        <progress aria-label={text.run.progress} />
        <small>{text.run.finishing}</small>
      </span>
    );
  const label = text.run.progressOf(progress.done, progress.total, progress.unit);
  return (
    <span class="progress">
      <progress aria-label={text.run.progress} value={progress.done} max={progress.total} />
      <small>{label}</small>
    </span>
  );
}

/** How far something came that was cancelled. */
export function Cancelled({ progress }: { progress: Progress | null | undefined }) {
  return (
    <p class="note">
      {text.run.cancelled}
      {progress && <> {text.run.cameTo(text.run.progressOf(progress.done, progress.total, progress.unit))}</>}
    </p>
  );
}

/** Whether the service has no worker; it is only asked while nothing moves. */
function useNoWorker(done: number): boolean {
  const [none, set] = useState(false);
  useEffect(() => {
    set(false);
    const look = () =>
      void api.health().then(
        (health) => set(health.workers === 0),
        () => set(false),
      );
    const timer = setInterval(look, LOOK_MS);
    return () => clearInterval(timer);
  }, [done]);
  return none;
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
