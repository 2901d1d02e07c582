/** Words of gearboxes. */
export const gearboxWords = {
  title: "Gearboxes",
  intro:
    "Read the motor's encoder and the encoder behind the gearbox at rest, without and with a weighed load. The result is the stiffness of each gearbox, without a tracker. Logs of a motion are a check within a factor of 1.5.",
  readings: "Weight step or logs",
  drop: "Drop a file of a weight step or of logs here",
  dropHint:
    "JSON with “load” and “observations”, or with “motion”; or a table with columns “motor [deg]” and “link [deg]”",
  notReadings: [
    "No weight step and no logs in this file",
    "The file needs “load”, and “observations” with “encoder_readings”; or “motion” with “logs” and “payload”. A table needs “motor” and “link”. docs/without-a-tracker.md shows the form.",
  ],
  postures: "Postures",
  logs: "Logs",
  payload: "Payload",
  joints: "Joints",
  load: "Load",
  ofLoad: {
    mass: "Mass of the load",
    mass_uncertainty: "Standard uncertainty of the mass",
    point: "Centre of mass in the flange frame",
    point_uncertainty: "Standard uncertainty of each coordinate",
  },
  robot: "Robot",
  robotHint: "The robot's model gives the load's lever about each joint.",
  pickRobot: "Choose one",
  identify: "Identify the gearboxes",
  result: "Gearboxes, motor to link encoder",
  verdicts: {
    use: "The steps determine these gearboxes.",
    use_with_care: "Read the findings before you use these numbers.",
    do_not_use: "The readings have a fault. Correct it before you use these numbers.",
  },
};
