/** Words of the wall. */
export const wallWords = {
  title: "Changes",
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
};
