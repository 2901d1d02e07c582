/** Faults of a request at the fields they are about. */
import type { Problem } from "../api/types";

interface Fault {
  where: string;
  reason: string;
  remedy?: string | null;
}

/** All faults of a problem, also where it has but one. */
export function faultsOf({ errors, where, detail, remedy }: Problem): Fault[] {
  return errors && errors.length > 0 ? errors : [{ where: where ?? "", reason: detail, remedy: remedy ?? null }];
}

const within = (where: string, path: string): boolean =>
  where === path || where.startsWith(`${path}.`) || where.startsWith(`${path}[`);

/** Reasons whose place is `path` or within it, each once and with its remedy. */
export function faultsAt(problem: Problem | null, path: string): string[] {
  if (!problem) return [];
  const here = faultsOf(problem).filter(({ where }) => within(where, path));
  return [...new Set(here.map(({ reason, remedy }) => (remedy ? `${reason}: ${remedy}` : reason)))];
}

/** A problem without the faults that stand at their fields already. */
export function elsewhere(problem: Problem, paths: string[]): Problem {
  const errors = (problem.errors ?? []).filter(({ where }) => !paths.some((path) => within(where, path)));
  const said = paths.some((path) => within(problem.where ?? "", path));
  return { ...problem, errors, ...(said ? { where: null, remedy: null } : {}) };
}
