/** Short names for the messages of the API. The shapes come from its OpenAPI description. */
import type { components } from "./schema";

type Schemas = components["schemas"];

export type Action = Schemas["Action-Output"];
export type Advice = Schemas["Advice"];
export type Assessment = Schemas["Assessment"];
export type Authorisation = Schemas["Authorisation"];
export type AuthorisationRequest = Schemas["AuthorisationRequest"];
export type AuthorisationList = { items: Authorisation[] };
export type Budget = Schemas["Budget"];
export type Catalogue = Schemas["Catalogue"];
export type ComparedRun = Schemas["ComparedRun"];
export type Comparison = Schemas["Comparison"];
export type ComparisonSummary = Schemas["ComparisonSummary"];
export type DeflectionResult = Schemas["DeflectionResult"];
export type DhModel = Schemas["DhModel-Output"];
/** Columns of a DH table that every row has. */
export type DhColumn = Exclude<keyof DhRow, "lower" | "upper" | "kind">;
type DhRow = Schemas["DhRow-Output"];
export type Geometry = Schemas["Geometry"];
export type GeometryResult = Schemas["GeometryResult"];
export type GeometrySummary = Schemas["GeometrySummary"];
export type Health = Schemas["Health"];
export type ImportAnswer = Schemas["ImportAnswer"];
export type ImportOptions = Partial<Schemas["ImportRequest"]>;
export type JointKind = Schemas["Joint"]["kind"];
export type JointMap = Schemas["JointMap"];
export type JointResult = Schemas["JointResult"];
export type Kinematics = Schemas["Kinematics"];
export type LiveOptions = Schemas["LiveOptions-Output"];
export type LiveState = Schemas["LiveState"];
export type Map = Schemas["Map"];
export type MapRequest = Schemas["MapRequest-Output"];
export type MapSummary = Schemas["MapSummary"];
export type ProgramSummary = Schemas["ProgramSummary"];
export type MeasurementSet = Schemas["MeasurementSet"];
export type MeasurementSetSummary = Schemas["MeasurementSetSummary"];
/** What people note about a measurement set. */
export type Metadata = Required<Pick<MeasurementSet, (typeof METADATA)[number]>>;
export type NominalArm = Schemas["Arm"];
export type Observation = Schemas["Observation-Output"];
export type OpenSet = Schemas["OpenSet"];
export type Plan = Schemas["Plan"];
export type PlanRequest = Schemas["PlanRequest-Output"];
export type PlanResult = Schemas["PlanResult"];
export type PlanSummary = Schemas["PlanSummary"];
export type Posture = Schemas["Posture"];
export type Problem = Schemas["Problem"];
export type Program = Schemas["Program"];
export type ProgramResult = Schemas["ProgramResult"];
export type Progress = Schemas["Progress"];
export type Finding = Schemas["Finding"];
export type Contribution = Schemas["Contribution"];
export type Residual = Schemas["Residual"];
export type Robot = Schemas["Robot"];
export type RobotChange = Schemas["RobotChange"];
export type RobotDocument = Schemas["RobotDocument-Input"];
export type RobotRequest = Schemas["RobotRequest"];
export type RobotSummary = Schemas["RobotSummary"];
export type Run = Schemas["Run"];
export type RunOptions = Omit<Schemas["RunRequest-Output"], "measurement_set_id" | "variant_of" | "leave_out">;
export type RunRequest = Schemas["RunRequest-Output"];
export type RunResult = Schemas["RunResult"];
export type RunSummary = Schemas["RunSummary"];
/** Changes of a measurement set; of an open one, what becomes of its readings, too. */
export type SetChange = Schemas["LiveSetChange"];
export type Fleet = Schemas["Fleet"];
export type FleetRow = Schemas["FleetRow"];
export type Trend = Schemas["Trend"];
export type OpenAlarm = Schemas["OpenAlarm"];
export type TrendAlarm = Schemas["TrendAlarm"];
export type TrendChange = Schemas["TrendChange"];
export type TrendJoint = Schemas["TrendJoint"];
export type TrendState = TrendJoint["state"];
export type Units = Schemas["Units-Output"];

export type Elasticity = RunRequest["elasticity"];
export type Loss = Exclude<RunRequest["loss"], "automatic">;
export type ElementKind = Schemas["ElementShare"]["kind"];
export type Method = RunRequest["method"];
export type NewWebhook = Schemas["NewWebhook"];
export type Webhook = Schemas["Webhook"];
export type Observability = Schemas["ObservabilityIndices"];
export type RunState = Run["state"];
export type Session = Schemas["Session"];
export type Solver = RunResult["certificate"]["solved_by"][number];
export type Usability = Assessment["verdict"];
export type Weighting = RunRequest["weighting"];

/** A table for people, each cell a text. */
export interface ShownTable {
  title: string;
  caption: string;
  head: string[];
  rows: string[][];
  /** Places of the columns that hold text. */
  texts: number[];
}

/** One page of a listing. */
export interface Page<Item> {
  items: Item[];
  next: string | null;
}

/** A robot that is stored, or one that is not yet. */
export type RobotSource = { robot_id: string } | { robot: RobotDocument };

/** Fields of a measurement set that may change after its readings. */
export const METADATA = [
  "measured_at",
  "serial_number",
  "item_condition",
  "operator",
  "instrument",
  "conditions",
  "notes",
] as const satisfies readonly (keyof MeasurementSet)[];
