/** Words of the start. */

export const startWords = {
  anotherFile: "Choose another file, or a stored set",
  example: "Try an example",
  exampleHint: "The example has a robot and readings; a simulated arm can be measured live.",
  goOn: "Go on",
  liveHint: "Take one reading at a time; after each reading, the page shows the next one.",
  liveWay: "At the robot",
  needRobot: "This file has no robot. Choose the robot that was measured.",
  noReadings: "No readings at hand?",
  notReady: "Choose a file first",
  readFindings: "Read the findings; tap again to identify anyway",
  recent: "Latest runs",
  recentNone: "Your first run will appear here.",
  title: "From readings to joint stiffness",
  none: "No runs yet",
};
