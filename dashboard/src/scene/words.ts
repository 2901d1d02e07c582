/** Words of the 3D views. */
export const sceneWords = {
  hint: "Drag to orbit, pinch or scroll to zoom. Arrow keys orbit, + and − zoom, 0 resets.",
  canvas: (label: string) => `Robot in configuration ${label}. Arrow keys orbit, plus and minus zoom.`,
  canvasPlain: "Robot. Arrow keys orbit, plus and minus zoom.",
  previous: "Previous",
  next: "Next",
  of: (index: number, total: number) => `${index} of ${total}`,
  measured: "Measured",
  predicted: "Predicted",
  axes: "Joint axes",
  labels: "Names",
  colour: "Colour of the arrows",
  byKind: "Kind",
  residualRamp: (worst: string) => `Measured, by residual: 0 to ${worst}`,
  bend: "Show bend",
  backTo: (view: string) => `Back to ${view}`,
  scale: (length: string, deflection: string | null) =>
    deflection === null ? `${length} m` : `${length} m, deflections ${deflection} mm`,
  all: "Deflections of all configurations",
  magnified: (factor: string) => `Deflections ×${factor}`,
  scaleDown: "Shorter arrows",
  scaleUp: "Longer arrows",
  reset: "Reset view",
  noWebgl: "This device does not support 3D graphics; a sketch of the arm and its load:",
  loading: "Preparing the 3D view…",
};

export const boxWords = {
  view: "Robot with the work area; the field below has the corners of the area. Arrow keys orbit, plus and minus zoom.",
  hint: "Drag a face or the middle of the box, or type its corners.",
  begin: "Draw a box at the flange",
};
