/** How long something will take, from how far it came since it was first looked at. */

export interface Mark {
  /** Units that were done. */
  done: number;
  /** When, in milliseconds. */
  at: number;
}

/** Seconds left at the speed between two marks; null while that cannot be said. */
export function secondsLeft(first: Mark, last: Mark, total: number): number | null {
  const speed = (last.done - first.done) / (last.at - first.at);
  return speed > 0 && Number.isFinite(speed) ? Math.max(0, total - last.done) / speed / 1000 : null;
}

/** A time in words that suit its size: 5 s, 40 s, 3 min, 2 h. */
export function roughTime(seconds: number): string {
  if (seconds < 10) return `${Math.max(1, Math.round(seconds))} s`;
  if (seconds < 90) return `${10 * Math.round(seconds / 10)} s`;
  return seconds < 5400 ? `${Math.round(seconds / 60)} min` : `${Math.round(seconds / 3600)} h`;
}
