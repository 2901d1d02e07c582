/** Choices among what is stored: the first of a listing, and others by a search of the service. */
import { keepPreviousData } from "@tanstack/query-core";
import type { ComponentProps } from "preact";
import { useEffect, useState } from "preact/hooks";
import { queries } from "../api/queries";
import type { MeasurementSetSummary, RobotSummary } from "../api/types";
import { text } from "../words";
import { FROM_FILE, ROBOTS, robotsToldApart, SETS, setsToldApart } from "../state/choices";
import { isKnown, useQuery } from "../state/query";
import { Busy, Choice } from "./basics";
import { Select, TextField } from "./fields";

const PAUSE_MS = 250;

/** A text that is typed, taken over once one pauses. */
export function useTyped(value: string, change: (value: string) => void): [string, (typed: string) => void] {
  const [typed, setTyped] = useState(value);
  useEffect(() => setTyped(value), [value]);
  useEffect(() => {
    if (typed === value) return undefined;
    const timer = setTimeout(() => change(typed), PAUSE_MS);
    return () => clearTimeout(timer);
  }, [typed]);
  return [typed, setTyped];
}

interface Choices {
  options: { value: string; label: string }[];
  /** A search, where there are more than are listed. */
  search: { q: string; find: (q: string) => void } | null;
  /** Whether the service has answered. */
  known: boolean;
}

function useSearch(count: number, total: number | null | undefined, q: string, find: (q: string) => void) {
  return q !== "" || (total ?? 0) > count ? { q, find } : null;
}

type Fits = (robot: Pick<RobotSummary, "joints">) => boolean;
const anyRobot: Fits = () => true;

/** Robots to choose from, if they fit; the chosen one is among them however many there are. */
export function useRobotChoices(chosen: string, fits = anyRobot): Choices {
  const [q, find] = useState("");
  const listed = useQuery({ ...queries.robots(q ? { ...ROBOTS, q } : ROBOTS), placeholderData: keepPreviousData });
  const { data } = listed;
  const items = data?.items ?? [];
  const isMissing =
    data !== undefined && chosen !== "" && chosen !== FROM_FILE && !items.some(({ id }) => id === chosen);
  const { data: own } = useQuery({ ...queries.robot(chosen), enabled: isMissing });
  const search = useSearch(items.length, data?.total, q, find);
  const all = isMissing && own ? [own, ...items] : items;
  const names = robotsToldApart(all);
  const options = all.filter(fits).map(({ id, name }) => ({ value: id, label: names.get(id) ?? name }));
  return { options, search, known: isKnown(listed) };
}

/** Sets to choose from, with their robots; the chosen one is among them however many there are. */
export function useSetChoices(chosen: string): Choices & { items: MeasurementSetSummary[] } {
  const [q, find] = useState("");
  const listed = useQuery({ ...queries.sets(q ? { ...SETS, q } : SETS), placeholderData: keepPreviousData });
  const listedRobots = useQuery(queries.robots(ROBOTS));
  const { data } = listed;
  const robots = listedRobots.data?.items ?? [];
  const items = data?.items ?? [];
  const isMissing = data !== undefined && chosen !== "" && !items.some(({ id }) => id === chosen);
  const { data: own } = useQuery({ ...queries.set(chosen), enabled: isMissing });
  const search = useSearch(items.length, data?.total, q, find);
  const all = isMissing && own ? [own, ...items] : items;
  const [names, robotNames] = [setsToldApart(all), robotsToldApart(robots)];
  const options = all.map(({ id, robot_id: robot }) => ({
    value: id,
    label: [names.get(id), robotNames.has(robot) ? `(${robotNames.get(robot)})` : ""].filter(Boolean).join(" "),
  }));
  return { options, search, items, known: isKnown(listed) && isKnown(listedRobots) };
}

type SearchedProps = ComponentProps<typeof Select> & Pick<Choices, "search" | "known">;

/** A choice, with a search above it where there is one. */
export function SearchedSelect({ search, known, ...field }: SearchedProps) {
  const [typed, setTyped] = useTyped(search?.q ?? "", (q) => search?.find(q.trim()));
  if (!known) return <Busy />;
  const select = <Select {...field} />;
  if (!search) return select;
  return (
    <div class="searched">
      <TextField
        type="search"
        label={`${text.list.search}: ${field.label}`}
        placeholder={text.list.searchHint}
        value={typed}
        change={setTyped}
      />
      {select}
    </div>
  );
}

/** As many candidates are cards. */
const MOST_CARDS = 3;

interface FittingProps {
  label: string;
  value: string;
  change: (value: string) => void;
  none: string;
  fits: Fits;
}

/** One of the robots that fit: a few are cards that are all in view, more are a list. */
export function FittingRobot({ none, fits, ...field }: FittingProps) {
  const { options, search, known } = useRobotChoices(field.value, fits);
  if (known && options.length === 0 && !search) return null;
  const areCards = known && !search && options.length <= MOST_CARDS;
  if (areCards) return <Choice look="choice cards" {...field} options={options} />;
  const all = [{ value: "", label: none }, ...options];
  return <SearchedSelect {...field} search={search} known={known} options={all} />;
}

type ChooserProps = Omit<ComponentProps<typeof Select>, "options" | "value"> & { value: string };

interface RobotProps extends ChooserProps {
  /** What it is called that none is chosen. */
  none: string;
  /** The robot that a file brings along. */
  ofFile?: { name?: unknown } | null | undefined;
  /** Nothing is shown unless there are several. */
  several?: boolean;
}

export function RobotSelect({ none, ofFile, several = false, ...field }: RobotProps) {
  const { options, search, known } = useRobotChoices(field.value);
  if (several && known && options.length < 2 && !search) return null;
  return (
    <SearchedSelect
      {...field}
      search={search}
      known={known}
      options={[
        { value: "", label: none },
        ...(ofFile ? [{ value: FROM_FILE, label: text.start.fromFile(String(ofFile.name ?? "")) }] : []),
        ...options,
      ]}
    />
  );
}

export function SetSelect({ none, ...field }: ChooserProps & { none?: string }) {
  const { options, search, known } = useSetChoices(field.value);
  const all = none === undefined ? options : [{ value: "", label: none }, ...options];
  return <SearchedSelect {...field} search={search} known={known} options={all} />;
}
