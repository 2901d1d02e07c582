/** Words of fleets. */
export const fleetWords = {
  title: "Fleet",
  wall: "Robots and their joints: change since the first campaign",
  none: "No robot was measured yet",
  noneHint: "A robot appears in this list after the first campaign, with the change of each joint.",
  joint: (number: number) => `J${number}`,
  last: "Last campaign",
  same: (joint: string) => `${joint}: no change beyond chance`,
  sameShort: "no change beyond chance",
  untested: (joint: string) => `${joint}: not tested; two campaigns that determine it are needed`,
  untestedShort: "not tested",
  colours: "red: softer; blue: stiffer; the stronger, the more certain",
  all: "All robots",
  again: "Identify again",
  sets: "Sets",
  set: "Measurement set",
  unit: (unit: string) => `Stiffness in ${unit}, with its interval.`,
  intro:
    "Identify the last measurement set with loads of each robot again in one job, such as after an update. The API also accepts chosen sets and options.",
  start: "Identify all robots again",
  going: "Looking for the sets…",
  csv: "Table (CSV)",
};
