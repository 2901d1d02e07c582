/** The messages of the API, by the names of its OpenAPI description; those that differ here are below. */
import type * as messages from "./schema";

export type * from "./schema";
export type { Arm as NominalArm } from "./schema";

/** A set that is measured live. */
export type OpenSet = messages.MeasurementSet & { open: messages.LiveOptions };
export type JointKind = messages.JointResult["kind"];
export type LastCampaign = NonNullable<messages.RobotSummary["last_campaign"]>;
export type Progress = NonNullable<messages.Run["progress"]>;
export type Residual = messages.RunResult["residuals"][number];
export type TrendCampaign = messages.Trend["campaigns"][number];
export type TrendJoint = messages.Trend["joints"][number];
/** What people note about a measurement set. */
export type Metadata = Required<Pick<messages.MeasurementSet, (typeof METADATA)[number]>>;
export type RunOptions = Omit<messages.RunRequest, "measurement_set_id" | "variant_of" | "leave_out">;
export type Elasticity = messages.RunRequest["elasticity"];
export type Loss = messages.ModelChoice["loss"];
export type Method = messages.RunRequest["method"];
export type RunState = messages.Run["state"];
export type Usability = messages.Assessment["verdict"];

/** A run in a listing: what all kinds of jobs have there, and a run always has. */
export type RunSummary = Known<
  messages.JobSummary,
  "robot_id" | "measurement_set_id" | "method" | "weighting" | "positive" | "elasticity"
>;
type Known<Of, Name extends keyof Of> = Omit<Of, Name> & { [Each in Name]: NonNullable<Of[Each]> };

/** A table for people, each cell a text. */
export interface ShownTable {
  title: string;
  caption: string;
  head: string[];
  rows: string[][];
  /** Places of the columns that hold text. */
  texts: number[];
  /** Row and column of cells that must not be used. */
  dim: [number, number][];
  /** Row, column and numbers of cells that consist of numbers. */
  numbers: [number, number, NumberParts[]][];
}

/** A number of a cell; what it has not is empty. */
export interface NumberParts {
  value: string;
  interval: string;
  limit: string;
  unit: string;
  relative: number | null;
}

/** What the service says of a job in tables and lines. */
export interface ShownTables {
  tables: ShownTable[];
  lines: string[];
  evidence: string[];
}

/** One page of a listing; the first one says how many items there are. */
export interface Page<Item> {
  items: Item[];
  next: string | null;
  total: number | null;
}

/** A new bridge from a tracker, with the code that joins it; bridges are no part of the described API. */
export interface Paired {
  id: string;
  code: string | null;
  ends_at: string;
}

/** Where a tracker is to read: joints in rad or m, force in N. */
export interface BridgeStand {
  number: number;
  label: string;
  joints: number[];
  force: readonly number[];
  loaded: boolean;
  /** The target of each other name that the tracker sends; null: the name is left out. */
  names: Record<string, string | null>;
}

/** Positions [m] that a tracker read in the stand of a number, and why it reads none. */
export interface BridgeReading {
  number: number | null;
  points: Record<string, [number, number, number]>;
  /** Positions [m] of names that are no targets. */
  unknown: Record<string, [number, number, number]>;
  trouble: string | null;
}

export interface BridgeState {
  joined: boolean;
  /** Whether the command at the tracker was heard within the last seconds. */
  connected: boolean;
  reading: BridgeReading;
}

/** A robot that is stored, or one that is not yet. */
export type RobotSource = { robot_id: string } | { robot: messages.RobotDocument };

/** Fields of a measurement set that may change after its readings. */
export const METADATA = [
  "measured_at",
  "serial_number",
  "item_condition",
  "operator",
  "instrument",
  "conditions",
  "notes",
] as const satisfies readonly (keyof messages.MeasurementSet)[];
