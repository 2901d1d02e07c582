/** Words of geometries. */
export const geometryWords = {
  title: "Geometry",
  intro:
    "Turn each joint alone while a tracker reads targets on the flange. The result has the axes, base frame and wrist with their uncertainties, and the identified robot model.",
  readings: "Sweeps",
  drop: "Drop a file of sweeps or poses here",
  dropHint: "JSON, as in examples/sweeps.json",
  notReadings: [
    "No sweeps and no poses in this file",
    "The file needs “sweeps” (one joint turned at a time) or “poses”; examples/sweeps.json shows the form.",
  ],
  positions: "Positions",
  poses: "Poses",
  arc: "Arc",
  nominal: "Nominal model",
  nominalHint: "The nominal model gives names, limits and a comparison.",
  noNominal: "None: frames from the axes",
  pickNominal: "Choose one (needed for poses)",
  identify: "Identify the geometry",
  axesInScene: "Identified axes, model angle zero, R0",
  save: "Save as a robot",
  saveName: "Name of the robot",
  asMeasured: (name: string) => `${name}, as measured`,
  doubtful: "The findings show a fault in the readings. Save this robot only if you are sure that it is correct.",
  verdicts: {
    use: "The readings support this geometry.",
    use_with_care: "Read the findings before you use this geometry.",
    do_not_use: "The readings have a fault. Correct it before you use this geometry.",
  },
  result: "Result",
  noLinks: "A comparison needs a nominal model.",
};
