/** What a call was refused for, or why its answer did not come, as problem details. */
import { text } from "../words";
import type { Problem } from "./types";

/** A refusal, or an answer that did not come. */
export class ApiError extends Error {
  constructor(readonly problem: Problem) {
    super(problem.detail);
  }
}

/** Make the problem of something that the service does not state. */
export const localProblem = (words: { title: string; detail: string; remedy?: string }, status = 0): Problem => ({
  type: "about:blank",
  where: null,
  remedy: null,
  request_id: null,
  errors: [],
  status,
  ...words,
});

/** Describe an answer that is no message of the service. */
export function unreadable(status: number): ApiError {
  const { detail, ...words } = text.errors.unreadable;
  return new ApiError(localProblem({ ...words, detail: detail(status) }, status));
}

/** Describe what was thrown as problem details. */
export const problemOf = (error: unknown): Problem =>
  error instanceof ApiError ? error.problem : localProblem({ title: text.errors.unexpected, detail: String(error) });

/** Whether the service did not answer, or could not: the same call may succeed later. */
export function isAway(error: unknown): boolean {
  if (!(error instanceof ApiError)) return false;
  const { status } = error.problem;
  return status === 0 || status >= 500 || status === 429;
}

/** Whether a body is problem details. */
export const isProblem = (answer: unknown): answer is Problem =>
  typeof answer === "object" && answer !== null && "detail" in answer && "title" in answer;
