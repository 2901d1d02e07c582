/** What no file of readings says, as people state it, and the options of an import that come of it. */
import type { ImportOptions } from "../api/types";
import { posted, vectorIn } from "./entered";

/** m/s², standard gravity. */
const GRAVITY = 9.80665;

export interface Stated {
  name: string;
  encoders: "" | "motor" | "secondary";
  /** In mm. */
  loadPoint: string;
  load: "mass" | "force";
  /** kg. */
  mass: string;
  /** Force on the robot, axes of R0, N. */
  force: string;
  /** By target, flange frame, in mm. */
  targets: Record<string, string>;
  /** Whether values that were asked about are right. */
  unusual: boolean;
}

export const NOTHING_STATED: Stated = {
  name: "",
  encoders: "",
  loadPoint: "",
  load: "mass",
  mass: "",
  force: "",
  targets: {},
  unusual: false,
};

const shown = (vector: readonly number[] | null | undefined, times = 1): string =>
  vector?.map((part) => Number((part * times).toPrecision(12))).join(", ") ?? "";

/** Lengths of a template by those of the page, in mm: its own unit, else that of its files. */
const inMetres = ({ length_unit: unit, units }: ImportOptions): boolean => (unit ?? units?.length) === "m";

/** What a template states already. */
export function statedIn(options: ImportOptions): Stated {
  const { encoders, load_point: point, force, flange_targets: targets, units } = options;
  const length = inMetres(options) ? 1e3 : 1;
  const unit = { N: 1, kN: 1e3, kgf: GRAVITY }[units?.force ?? "N"];
  return {
    ...NOTHING_STATED,
    encoders: encoders ?? "",
    loadPoint: shown(point, length),
    load: force ? "force" : "mass",
    force: shown(force, unit),
    targets: Object.fromEntries(Object.entries(targets ?? {}).map(([target, place]) => [target, shown(place, length)])),
  };
}

/** The options with what is stated; what is no number yet counts as not stated. */
export function withStated(options: ImportOptions, stated: Stated): ImportOptions {
  const { encoders: _, load_point: _p, force: _f, flange_targets: _t, name: _n, ...others } = options;
  const metres = Boolean(options.noise) && inMetres(options); // a template's noise keeps its unit
  const sent = (place: [number, number, number]) =>
    (metres ? place.map((part) => part / 1e3) : place) as [number, number, number];
  const force = forceOf(stated);
  const point = vectorIn(stated.loadPoint);
  const places = Object.entries(stated.targets).flatMap(([target, typed]) => {
    const place = vectorIn(typed);
    return place ? [[target, sent(place)] as const] : [];
  });
  return {
    ...others,
    ...(stated.name.trim() === "" ? {} : { name: stated.name.trim() }),
    ...(stated.encoders === "" ? {} : { encoders: stated.encoders }),
    ...(point ? { load_point: sent(point) } : {}),
    ...(point || places.length > 0 ? { length_unit: metres ? ("m" as const) : ("mm" as const) } : {}),
    ...(stated.unusual ? { accept_unusual: true } : {}),
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
