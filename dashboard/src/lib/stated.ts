/** What no file of readings says, as people state it, and the options of an import that come of it. */
import type { ImportOptions } from "../api/types";
import { posted, vectorIn } from "./entered";

/** m/s², standard gravity. */
export const GRAVITY = 9.80665;

export interface Stated {
  name: string;
  encoders: "" | "motor" | "secondary";
  /** In the files' unit of length. */
  loadPoint: string;
  load: "mass" | "force";
  /** kg. */
  mass: string;
  /** Force on the robot, axes of R0, N. */
  force: string;
  /** By target, flange frame, in the files' unit of length. */
  targets: Record<string, string>;
}

export const NOTHING_STATED: Stated = {
  name: "",
  encoders: "",
  loadPoint: "",
  load: "mass",
  mass: "",
  force: "",
  targets: {},
};

const shown = (vector: readonly number[] | null | undefined): string => vector?.join(", ") ?? "";

/** What a template states already. */
export function statedIn({
  encoders,
  load_point: point,
  force,
  flange_targets: targets,
  units,
}: ImportOptions): Stated {
  const unit = { N: 1, kN: 1e3, kgf: GRAVITY }[units?.force ?? "N"];
  return {
    ...NOTHING_STATED,
    encoders: encoders ?? "",
    loadPoint: shown(point),
    load: force ? "force" : "mass",
    force: shown(force?.map((part) => part * unit)),
    targets: Object.fromEntries(Object.entries(targets ?? {}).map(([target, place]) => [target, shown(place)])),
  };
}

/** The options with what is stated; what is no number yet counts as not stated. */
export function withStated(options: ImportOptions, stated: Stated): ImportOptions {
  const { encoders: _, load_point: _p, force: _f, flange_targets: _t, name: _n, ...others } = options;
  const force = forceOf(stated);
  const point = vectorIn(stated.loadPoint);
  const places = Object.entries(stated.targets).flatMap(([target, typed]) => {
    const place = vectorIn(typed);
    return place ? [[target, place] as const] : [];
  });
  return {
    ...others,
    ...(stated.name.trim() === "" ? {} : { name: stated.name.trim() }),
    ...(stated.encoders === "" ? {} : { encoders: stated.encoders }),
    ...(point ? { load_point: point } : {}),
    ...(places.length > 0 ? { flange_targets: Object.fromEntries(places) } : {}),
    ...(force ? { force, units: { ...others.units, force: "N" as const } } : {}),
  };
}

/** The force in N: of a weight that hangs down, or as typed. */
function forceOf({ load, mass, force }: Stated): [number, number, number] | null {
  if (load === "force") return vectorIn(force) ?? null;
  const weight = posted(mass, GRAVITY);
  return typeof weight === "number" ? [0, 0, -weight] : null;
}
