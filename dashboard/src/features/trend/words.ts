/** Words of trends. */
import { plural } from "../../words/shared";

export const trendWords = {
  title: (robot: string) => `${robot} over time`,
  encoders: "Encoders",
  serial: "Serial number",
  none: "No campaigns in this trend",
  noneHint: "Identify a measurement set of this robot, or choose another method.",
  noSerial: "no serial number",
  campaigns: (shown: number, count: number) =>
    shown < count ? `${shown} of ${plural(count, "campaign", "campaigns")}` : plural(count, "campaign", "campaigns"),
  said: (note: string) => `${note.charAt(0).toUpperCase()}${note.slice(1)}.`,
  changed: "Changed",
  test: (level: number) =>
    `For each joint, the test compares the latest stiffness with the first. If no joint has changed, a change is reported with a probability of at most ${100 * level} %. `,
  axes: "Bars: intervals of the runs. Logarithmic axis.",
  joint: (name: string) => `Stiffness of ${name} over its campaigns`,
  reason: "Not compared because",
  verdict: (word: string) => `Verdict on its run: ${word}`,
  stored: (day: string) => `stored ${day}; the set has no date of measurement`,
  first: "the first campaign",
  latest: "the latest",
  named: (name: string, when: string) => `“${name}” (${when})`,
  compared: (first: string, latest: string) => `from ${first} to ${latest}`,
  pair: (changed: boolean, change: string, compared: string, p: string) =>
    `${changed ? "Changed" : "No change beyond chance"}: ${change} ${compared}, ${p}`,
  untested: "Not tested: fewer than two campaigns with a number",
  leftOut: (count: number) => `${plural(count, "campaign", "campaigns")} left out`,
};
