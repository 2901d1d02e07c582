/** Words of forms that are made from the description of the API. */
import type { DhModel, Metadata } from "../api/types";

/** Forms that are made from the service's description of its requests. */
export const formWords = {
  unread: (typed: string) => `“${typed.trim()}” is not understood: write numbers separated by blanks.`,
  understood: (value: string, unit: string) => `Understood as ${value} ${unit}`.trim(),
  lastForce: (force: string) => `Use ${force} N, the force of last time`,
  /** What a form needs before its button works. */
  lacking: {
    joints: "Give the joints",
    force_there: "Give the force",
    load_point: "Give the load point",
    program: "Choose the program",
    accuracy_option: "Choose the accuracy option of the controller",
    force: "Give the process force",
  },
  ends: ["Minimum", "Maximum"],
  add: "Add a row",
  removeLast: "Remove last",
  values: {
    "": "not stated",
    motor: "motor encoders",
    secondary: "secondary encoders",
    base: "R0",
    tracker: "the tracker",
    whitespace: "blanks",
    best: "least held-out residual",
    one_standard_error: "largest within one standard error",
    dead_weight: "Dead weight",
    cable: "Cable to anchors",
    any_direction: "Force in any direction",
    own_weight: "Own weight",
  } as Record<string, string>,
};

export const metadataWords = {
  title: "About this measurement",
  none: "Nothing noted yet.",
  edit: "Edit",
  add: "Add notes",
  save: "Save",
  cancel: "Cancel",
  fields: {
    measured_at: "Measured at",
    serial_number: "Serial number of the robot",
    item_condition: "Condition of the robot",
    operator: "Operator",
    instrument: "Instrument",
    conditions: "Conditions of the room",
    notes: "Notes",
  },
  placeholders: {
    serial_number: "F-211034",
    item_condition: "as found",
    operator: "M. Keller",
    instrument: "Leica AT960, 750123",
    conditions: "21 °C, warmed up for 30 min",
  } as Partial<Record<keyof Metadata, string>>,
  zone: "Times are in the time zone of this device.",
  from: "Measured from",
  to: "to",
};

export const sourceWords = {
  inBrackets: "In brackets",
  source: (level: string, withModel: boolean) =>
    `${level} interval, ${withModel ? "with model error" : "readings only: the model error is unknown"}`,
};

/** Joints in tables, forms and next to the arm. */
export const jointWords = {
  conventions: { standard: "Standard", modified: "Modified (Craig)" } satisfies Record<DhModel["convention"], string>,
  cell: (column: string, joint: number) => `${column} of joint ${joint}`,
  kinds: { revolute: "turns", prismatic: "slides" },
  sliders: "Move the joints",
  zero: "All to zero",
  angle: (joint: string) => `Angle of ${joint}`,
};
