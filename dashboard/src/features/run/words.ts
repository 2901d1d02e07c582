/** Words of a run. */
export const deflectionWords = {
  title: "Deflection before and after compensation",
  note: "Mean length over the targets of a configuration, as measured and minus the prediction.",
  before: "before",
  afterBy: (method: string) => `after, ${method}`,
  length: "Deflection",
  residuals: "Residuals",
  residualsNote: "Measured minus predicted, by target and coordinate. The band should contain 95 % of the residuals.",
  residual: "Residual",
  target: "Target",
  band: "±1.96 √2 σ",
  byConfiguration: "Contribution of each joint, by configuration",
  byConfigurationNote: "Mean contribution of each joint along the predicted deflection.",
};

export const armWords = {
  deflects: (length: string) => `deflects by ${length} mm`,
  drawn: (force: string | null, factor: string) =>
    force === null ? `drawn ×${factor}` : `under ${force} N, drawn ×${factor}`,
  part: "Contribution of a joint",
  ofJoint: (length: string | null) => (length === null ? "does not contribute" : `contributes ${length} mm`),
  pull: "Pull the tool",
};

export const evidenceWords = {
  model: "Model",
  title: "Evidence",
  rank: "Rank",
  rankOf: (rank: number, total: number) => `${rank} of ${total}`,
  jointsAlone: "Joint model only: elastic links are not included.",
  combinations: "Observable only in combination",
  certificate: "Optimality certificate",
  solvedBy: "Solved by",
  solvers: {
    least_squares: "least squares",
    pivoting: "principal pivoting",
    clarabel: "Clarabel",
    active_set: "exact active set",
    least_distance: "least distance",
  },
  provenance: "Provenance",
  created: "Created",
  versions: "Versions",
  request: "Request",
};

export const partWords = {
  gearbox: "gearbox",
  structure: "structure behind the encoder",
};

export const nextWords = {
  title: (joint: string) => `Next for ${joint}:`,
  posture: (observation: string) => `posture of ${observation}`,
  newPosture: "a new posture (check that it is free of collisions)",
  load: (load: string) => `load ${load}`,
  along: (direction: string) => `along (${direction}) in R0`,
  down: "straight down",
  gain: "standard uncertainty",
  unknown: "undetermined",
  below: (stiffness: string) => `determined, if the joint is softer than ${stiffness}`,
  copy: "Copy angles",
  copied: "Angles copied",
  other: "Alternative",
};
