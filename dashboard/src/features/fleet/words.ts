/** Words of fleets. */
export const fleetWords = {
  title: "Fleets",
  intro:
    "Identify the last measurement set with loads of each robot again in one job, such as after an update. The API also accepts chosen sets and options.",
  start: "Identify all robots again",
  going: "Looking for the sets…",
  csv: "Table (CSV)",
};
