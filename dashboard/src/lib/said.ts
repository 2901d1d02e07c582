/** What has been said of a result, so that nothing is said twice. */
import type { Finding } from "../api/types";
import { text } from "../words";

const UNEXPLAINED = ["deflections_unexplained", "residual_outlier"];

/** Warnings that a reason says better. */
const SAID_BETTER: Record<string, string[]> = {
  deflection_unexplained: UNEXPLAINED,
  alternative_explains_better: [...UNEXPLAINED, "joint_sign_suspect", "joints_swapped", "joints_counted_otherwise"],
};

/** The warnings that no reason says or sums up. */
export function unsaid(warnings: Finding[], reasons: Finding[]): Finding[] {
  const said = new Set<string>(reasons.map((reason) => reason.code));
  for (const { code } of reasons) for (const same of SAID_BETTER[code] ?? []) said.add(same);
  return warnings.filter(({ code }) => !said.has(code));
}

/** The label of an observation, of a place in what was posted; of two sides with its side. */
export function placeName(where: string): string {
  const [, side, label] = /^(?:(first|second)\.)?observations\[\d+\] '(.+)'$/.exec(where) ?? [];
  return label === undefined ? where : side === undefined ? label : `${label} (${side})`;
}

/** A sentence of the service with a capital; names and code stay as they are. */
export const sentence = (words: string): string =>
  /^[a-z]+[ ,:;]/.test(words) ? words[0]?.toUpperCase() + words.slice(1) : words;

/** The first sentence of a message, which fits a line, and the rest. */
export function firstSentence(message: string): [string, string] {
  const end = /[a-z)]\. (?=[A-Z])/.exec(message);
  return end ? [message.slice(0, end.index + 2), message.slice(end.index + 3)] : [message, ""];
}

/** Whether a note says what the readings doubt or do not show: such a note is no assumption. */
export const isUnseen = (note: string): boolean =>
  /\b(raise a doubt|cannot be checked|not detected|no reading would show)\b/.test(note);

/** A field of a request as a person calls it; other code as it is. */
export const fieldName = (code: string): string | undefined => text.fields[code];

/** Probabilities that nobody needs to ten digits. */
export const roundedP = (prose: string): string => prose.replace(/\bp = \d(?:\.\d+)?e-\d+/g, "p < 0.001");

/** A remark of the service as it is read on the page itself, where nobody sends requests by hand. */
export const onPage = (remark: string): string =>
  remark.replace("on the page:", `${text.app.measure}:`).replace(/; list the existing ids with GET \S+$/, "");
