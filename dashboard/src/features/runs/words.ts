/** Words of the list of runs. */

export const runListWords = {
  clear: "Clear",
  explained: "explained",
  groups: "Group by set",
  joints: "joints",
  select: (name: string) => `Select ${name}`,
  selected: (count: number) => `${count} selected`,
  warnings: (count: number) => (count === 1 ? "warning" : "warnings"),
  state: "State",
};
