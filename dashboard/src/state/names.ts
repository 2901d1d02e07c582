/** Names of robots and sets by their identifiers, for lists that only have those. */
import { api, every } from "../api/client";
import type { MeasurementSet, MeasurementSetSummary, OpenAlarm, Robot, RobotSummary } from "../api/types";
import { cached, forget, type Loading, useCached } from "./load";
import { text } from "../i18n";

export interface Names {
  robots: RobotSummary[];
  sets: MeasurementSetSummary[];
  /** What lists leave out; its names still stand on runs. */
  archived: { robots: RobotSummary[]; sets: MeasurementSetSummary[] };
  /** Of robots of one name with serial number, number of joints and last campaign. */
  robot: (id: string) => string;
  set: (id: string) => string;
  /** Alarms of the arm that a set is of, that nobody has acknowledged. */
  alarms: (robot: string, set: string) => OpenAlarm[];
}

const KEY = "names";

/** All names; an identifier that is not among them stands for itself. */
export function useNames(): Loading<Names> {
  return useCached(KEY, loadNames);
}

/** A robot or a set was added, deleted, restored, or changed. */
export const namesChanged = (): void => [KEY, "robot/", "set/"].forEach(forget);

/** Robots and measurement sets. Sets never change but by what is noted of them; alarms of robots come and go. */
export const storedSet = (id: string): Promise<MeasurementSet> => cached(`set/${id}`, () => api.sets.one(id));
export const storedRobot = (id: string): Promise<Robot> => cached(`robot/${id}`, () => api.robots.one(id), 2_000);

/** Those of a robot's alarms that are of one arm. */
export const ofArm = (alarms: OpenAlarm[], serial: string | null | undefined): OpenAlarm[] =>
  alarms.filter((alarm) => alarm.serial_number === (serial ?? null));

async function loadNames(): Promise<Names> {
  const away = { archived: "true" };
  const [robots, sets, oldRobots, oldSets] = await Promise.all([
    every(api.robots.list, {}, 1000),
    every(api.sets.list, {}, 1000),
    every(api.robots.list, away, 1000),
    every(api.sets.list, away, 1000),
  ]);
  const robotNames = toldApart([...robots, ...oldRobots], [...sets, ...oldSets]);
  const setNames = setsToldApart([...sets, ...oldSets]);
  const alarms = new Map([...robots, ...oldRobots].map((robot) => [robot.id, robot.alarms]));
  const serials = new Map([...sets, ...oldSets].map((set) => [set.id, set.serial_number]));
  return {
    robots,
    sets,
    archived: { robots: oldRobots, sets: oldSets },
    robot: (id) => robotNames.get(id) ?? id.slice(0, 8),
    set: (id) => setNames.get(id) ?? id.slice(0, 8),
    alarms: (robot, set) => ofArm(alarms.get(robot) ?? [], serials.get(set)),
  };
}

/** The name of each set; where several have it, with serial number and time. */
export function setsToldApart(
  sets: Pick<MeasurementSetSummary, "id" | "name" | "serial_number" | "measured_at" | "created_at">[],
): Map<string, string> {
  const several = new Set(
    sets.flatMap(({ name }, i) => (sets.findIndex((one) => one.name === name) < i ? [name] : [])),
  );
  return new Map(
    sets.map(({ id, name, serial_number: serial, measured_at: at, created_at: stored }) => [
      id,
      several.has(name)
        ? [name, ...(serial ? [serial] : []), (at ?? stored).slice(0, 16).replace("T", " ")].join(" · ")
        : name,
    ]),
  );
}

/** The name of each robot; where several have it, with what tells them apart. */
export function toldApart(
  robots: Pick<RobotSummary, "id" | "name" | "created_at" | "joints">[],
  sets: Pick<MeasurementSetSummary, "robot_id" | "serial_number" | "measured_at" | "created_at">[],
): Map<string, string> {
  return new Map(
    robots.map(({ id, name, created_at, joints }) => {
      const own = sets.filter((set) => set.robot_id === id);
      const serials = own.flatMap(({ serial_number }) => serial_number ?? []);
      const last = own
        .map((set) => set.measured_at ?? set.created_at)
        .sort()
        .at(-1);
      const when = last ? text.lists.measuredOn(last.slice(0, 10)) : text.lists.addedOn(created_at.slice(0, 10));
      const hints = [...new Set(serials), text.lists.jointCount(joints.length), when];
      const alone = robots.filter((other) => other.name === name).length === 1;
      return [id, alone ? name : [name, ...hints].join(" · ")];
    }),
  );
}

/** Robots to choose from, after a first option that is none or of a file. */
export const robotOptions = (names: Names | null, ...first: { value: string; label: string }[]) => [
  ...first,
  ...(names?.robots ?? []).map(({ id }) => ({ value: id, label: names?.robot(id) ?? id })),
];

/** Sets to choose from, with their robots. */
export const setOptions = (names: Names) =>
  names.sets.map(({ id, robot_id: robot }) => ({ value: id, label: `${names.set(id)} (${names.robot(robot)})` }));
