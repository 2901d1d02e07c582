/** Words of imports and of the options of a run. */
import type { ImportAnswer, Mapping, Role } from "../../api/types";
import { fixed } from "../../lib/format";
import { plural } from "../../words/shared";
import type { RoleName } from "./mapping";

export const importWords = {
  readingFiles: "Reading the files…",
  checking: "Checking…",
  size: (rows: number, columns: number) => `${plural(rows, "row", "rows")}, ${plural(columns, "column", "columns")}`,
  firstRows: (table: string) => `First rows of ${table}`,
  hint: "Tap a role to change it.",
  columns: (range: string) => (range.includes("–") ? `Columns ${range}` : `Column ${range}`),
  unused: "not used",
  roles: {
    label: "name of the posture",
    joints: "joints",
    position: "position x, y, z",
    displacement: "displacement",
    force: "force",
    moment: "moment",
    load: "size of the load",
    mass: "mass of the weight",
    target: "name of the target",
    state: "state: loaded or not",
    point: "target and state",
    axis: "axis: x, y or z",
    value: "coordinate",
    uncertainty: "uncertainty U95",
    ignore: "only tells rows apart",
  } satisfies Record<RoleName, string>,
  /** Roles in the order of a table. */
  offered: [
    "label",
    "joints",
    "position",
    "displacement",
    "force",
    "moment",
    "mass",
    "load",
    "target",
    "state",
    "point",
    "axis",
    "value",
    "uncertainty",
  ] satisfies RoleName[],
  target: "Target",
  another: (name: string) => `new: ${name}`,
  state: "State",
  states: { unloaded: "unloaded", loaded: "loaded", unloaded_after: "unloaded after" },
  byRow: "named in the rows",
  unit: "Unit",
  units: { deg: "°", "N.m": "N·m", "N.mm": "N·mm", "kN.m": "kN·m" } as Partial<
    Record<NonNullable<Role["unit"]>, string>
  >,
  axis: "Axis of R0",
  meaningOf: (word: string) => `“${word}” means`,
  asWritten: "as written",
  leaveOut: "leave the row out",
  columnsField: "Columns",
  columnsHelp: "B:G, or B,D,F; G:B counts from the last to the first.",
  done: "Done",
  far: ({ posture, target, state, distance }: ImportAnswer["far"][number], size: string) =>
    `${[posture, target, state].filter(Boolean).join(" ")}: ${distance < 1000 ? `${size} mm` : "over 1 m"} from where the robot carries it`,
  next: "Next",
  asLast: ({ encoders, load_point: point, load_point_target: target, force }: Partial<Mapping>) => {
    const places = point ? `load point ${point.map((part) => fixed(part, 1)).join(", ")} mm` : "";
    const pull = force ? `force ${force.map((part) => fixed(part, 0)).join(", ")} N` : "";
    const hook = target ? `load point at ${target}` : "";
    return `As last time: ${[encoders && `${encoders} encoders`, places, hook, pull].filter(Boolean).join("; ")}`;
  },
  stated: "What the files do not say",
  labels: {
    encoders: "Position loop closed by",
    force: "Force on the robot, x, y, z, axes of R0",
    load_point: "Load point, x, y, z, flange frame",
    load_point_target: "Or the target at the hook",
    flange_targets: "Positions of the targets in the flange frame: name, x, y, z, one per line",
  },
  mass: "Mass of the hung weight",
  massHelp: "The same in all postures; pulls along −z of R0, with 9.80665 N per kilogram.",
  orForce: "Or the force on the robot, x, y, z, axes of R0",
  weightStep: "The file has angles of two encoders, without and with a load.",
  toGearboxes: "Go on to the gearboxes",
  poses:
    "The positions are without a load. They identify the geometry of the robot: save the poses, then `jointstiff geometry poses.json` at the terminal.",
  savePoses: "Save poses",
  noRobots: "No robot is stored. Add it; the files stay here.",
  saveMapping: "Save mapping",
  mappingFirst: (name: string) => `Mapping “${name}”: drop the tables to read with it.`,
  open: {
    robot: "Which robot was measured?",
    questions: (count: number) => `${plural(count, "question is", "questions are")} open`,
    faults: "Correct what is wrong first",
  },
};

/** Options of a run, in the words of the glossary. */
export const settingWords = {
  title: "Advanced",
  defaults: "The defaults give the best known result",
  labels: {
    positive: "Keep every stiffness positive",
    weight: "Own weight is the load (needs masses of the robot)",
    resampling: "Resample: repeat on random draws of configurations",
    "resampling.repetitions": "Draws",
    "resampling.size": "Configurations in a draw",
    "cross_validation.draws": "Draws of the folds",
    "cross_validation.seed": "Seed of the folds",
    elasticity: "Elastic elements",
    stiffness_bounds: "Bounds of the stiffness",
    stiffness_order: "Order: stiffer joint, softer joint, one order per line",
  },
  noiseTitle: "Noise of the readings and of the load",
  noiseHelp:
    "Standard uncertainties, coverage factor 1. If you change nothing, the stated values of the set are used; a change is stored as a new set.",
  residuals: "Estimate the tracker’s noise from the residuals",
  noise: {
    sigma: "σ of one coordinate",
    instrument: "Data sheet of the tracker",
    "instrument.station": "Position of the tracker, in the frame of the positions",
    "instrument.range.constant": "Along the line of sight",
    "instrument.range.per_distance": "Along it, per metre",
    "instrument.transverse.constant": "Across the line of sight",
    "instrument.transverse.per_distance": "Across it, per metre",
    force: "Uncertainty of the load",
    "force.scale": "Scale of the force",
    "force.direction": "Direction of the force",
    load_point: "Uncertainty of the load point",
    grounds: "What the statements rest on",
    "grounds.load_point": "How the load point is known",
    "grounds.force": "What the force is known by",
    "grounds.tared": "Load cell tared before each reading",
    "grounds.between": "What the controller did between the two readings of a posture",
    target_places: "Uncertainty of the targets’ positions",
    drift: "Drift from one observation to the next",
    encoder_sigma: "Secondary encoder",
    repeatability: "Repeatability of a joint",
  },
};
