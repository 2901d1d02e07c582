/** Words of the command palette. */
export const paletteWords = {
  title: "Find robots, sets, runs and actions",
  none: "No match",
  kinds: { action: "Action", view: "View", robot: "Robot", set: "Measurement set", run: "Run" },
};
