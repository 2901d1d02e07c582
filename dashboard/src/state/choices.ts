/** Robots and sets to choose from, with names that tell them apart. */
import type { MeasurementSetSummary, RobotDocument, RobotSource, RobotSummary } from "../api/types";
import { text } from "../i18n";
import { dayText, timeText } from "../lib/format";

/** Robots by name, and the newest sets: as many as a page of a listing has. */
export const ROBOTS = { sort: "name", limit: 100 } as const;
export const SETS = { limit: 100 } as const;

/** The name of each item; where several have it, with hints that tell them apart. */
function toldApart<Item extends { id: string; name: string }>(
  items: Item[],
  hints: (item: Item) => string[],
): Map<string, string> {
  const several = new Set(
    items.filter(({ name }, i) => items.findIndex((one) => one.name === name) < i).map(({ name }) => name),
  );
  const shown = (item: Item) => (several.has(item.name) ? [item.name, ...hints(item)].join(" · ") : item.name);
  return new Map(items.map((item) => [item.id, shown(item)]));
}

/** Sets with serial number and time. */
export const setsToldApart = (
  sets: Pick<MeasurementSetSummary, "id" | "name" | "serial_number" | "measured_at" | "created_at">[],
): Map<string, string> =>
  toldApart(sets, ({ serial_number: serial, measured_at: at, created_at: stored }) => [
    ...(serial ? [serial] : []),
    timeText(at ?? stored),
  ]);

/** Robots with the serial number that was measured last, number of joints and last campaign. */
export const robotsToldApart = (
  robots: Pick<RobotSummary, "id" | "name" | "created_at" | "joints" | "last_campaign">[],
): Map<string, string> =>
  toldApart(robots, ({ last_campaign: last, created_at, joints }) => [
    ...(last?.serial_number ? [last.serial_number] : []),
    text.lists.jointCount(joints.length),
    last ? text.lists.measuredOn(dayText(last.at)) : text.lists.addedOn(dayText(created_at)),
  ]);

/** The robot that a file brings along, among those to choose from. */
export const FROM_FILE = "file";

/** The robot of a choice, that of a file or a stored one. */
export const sourceOf = (chosen: string | undefined, ofFile: RobotDocument | null | undefined): RobotSource | null =>
  chosen === FROM_FILE ? (ofFile ? { robot: ofFile } : null) : chosen ? { robot_id: chosen } : null;
