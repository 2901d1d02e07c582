/** Robots and sets to choose from, with names that tell them apart. */
import type { MeasurementSetSummary, RobotDocument, RobotSource, RobotSummary } from "../api/types";
import { text } from "../words";
import { dayText, timeText } from "../lib/format";
import { recalled, remember } from "./kept";

/** Robots by name, and the newest sets: as many as a page of a listing has. */
export const ROBOTS = { sort: "name", limit: 100 } as const;
export const SETS = { limit: 100 } as const;

/** The name of each item; where several have it, with hints that tell them apart, at last with a part of the id. */
function toldApart<Item extends { id: string; name: string }>(
  items: Item[],
  hints: (item: Item) => string[],
): Map<string, string> {
  const more = [hints, ({ id }: Item) => [id.slice(0, SHORT_ID)]];
  let names = items.map(({ name }) => name);
  for (const further of more) {
    const count = new Map<string, number>();
    for (const name of names) count.set(name, (count.get(name) ?? 0) + 1);
    names = items.map((item, i) => {
      const name = names[i] ?? "";
      return (count.get(name) ?? 0) > 1 ? [name, ...further(item)].join(" · ") : name;
    });
  }
  return new Map(items.map(({ id }, i) => [id, names[i] ?? ""]));
}

const SHORT_ID = 6; // characters, as many as a person compares

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

const STORED_LAST = "robot.stored";

/** Keep in this window which robot was stored last: readings that come next are probably of this robot. */
export const keepStoredLast = (id: string): void => remember(STORED_LAST, id, "sessionStorage");

interface Listing {
  items: { id: string; joints: readonly unknown[] }[];
  total: number | null;
}

/** The robot to begin with where nobody chose one: the one stored last, else the only one there is; empty for none. */
export function likelyRobot({ items, total }: Listing, fits: (robot: Listing["items"][number]) => boolean): string {
  const fitting = items.filter(fits);
  const last = recalled(STORED_LAST, "sessionStorage");
  const storedLast = fitting.find(({ id }) => id === last);
  const isWhole = total === null || total <= items.length;
  const only = fitting.length === 1 && isWhole ? fitting[0] : undefined;
  return (storedLast ?? only)?.id ?? "";
}

/** The robot that a file brings along, among those to choose from. */
export const FROM_FILE = "file";

/** The robot of a choice, that of a file or a stored one. */
export const sourceOf = (chosen: string | undefined, ofFile: RobotDocument | null | undefined): RobotSource | null =>
  chosen === FROM_FILE ? (ofFile ? { robot: ofFile } : null) : chosen ? { robot_id: chosen } : null;
