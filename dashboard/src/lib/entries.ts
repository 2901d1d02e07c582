/** Keys and values of an object whose keys are known to the type checker. */
export const entriesOf = <Key extends string, Value>(of: { [key in Key]: Value }): [Key, Value][] =>
  Object.entries(of) as [Key, Value][];
