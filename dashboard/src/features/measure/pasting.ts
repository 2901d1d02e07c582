/** Blocks of readings pasted into a form: read one after the other, and kept until they are placed or discarded. */
import { useEffect, useRef, useState } from "preact/hooks";
import { api } from "../../api/calls";
import { problemOf } from "../../api/problem";
import type { ImportOptions, Problem } from "../../api/types";
import type { Rows, Typed } from "./live";
import { type Block, filesOf, type Placed, placed, type Unmatched } from "./paste";

export type DecimalMark = NonNullable<ImportOptions["decimal_mark"]>;

/** A block of which something is not in the form yet, and why. */
export interface Left extends Omit<Placed, "rows"> {
  block: Block;
  /** Why the service did not read the block. */
  problem: Problem | null;
}

export interface Pasting {
  /** Whether a block is being read. */
  busy: boolean;
  left: Left[];
  paste: (block: Block) => void;
  /** Read a block again, by a decimal mark if one is stated. */
  again: (left: Left, mark?: DecimalMark) => void;
  discard: (left: Left) => void;
  /** Put what a block says of an unknown target into the row of `target`; of another name, leave it out. */
  settle: (left: Left, unmatched: Unmatched, target: string) => void;
}

/** `change` applies a function to the rows as they are by then: a person types while the service reads. */
export function usePasting(rows: Rows, change: (by: (rows: Rows) => Rows) => void): Pasting {
  const [left, setLeft] = useState<Left[]>([]);
  const [count, setCount] = useState(0);
  const queue = useRef<Promise<void>>(Promise.resolve());
  const isOpen = useRef(true);
  const close = () => {
    isOpen.current = false;
  };
  useEffect(() => close, []); // the next posture has rows of its own
  const read = async (block: Block, stated: ImportOptions) => {
    const [files, options] = filesOf(block.text, Object.keys(rows), block.target);
    try {
      const answer = await api.importFiles(files, { ...options, ...stated });
      if (!isOpen.current) return;
      const { unmatched, faults, asksForMark } = placed(answer, rows, block.column, block.text);
      change((now) => placed(answer, now, block.column, block.text).rows);
      if (unmatched.length > 0 || faults.length > 0)
        setLeft((before) => [...before, { block, problem: null, unmatched, faults, asksForMark }]);
    } catch (error) {
      const nothing = { unmatched: [], faults: [], asksForMark: false };
      if (isOpen.current) setLeft((before) => [...before, { block, problem: problemOf(error), ...nothing }]);
    }
  };
  const enqueue = (block: Block, stated: ImportOptions = {}) => {
    setCount((before) => before + 1);
    queue.current = queue.current.then(() => read(block, stated)).then(() => setCount((before) => before - 1));
  };
  const discard = (one: Left) => setLeft((before) => before.filter((each) => each !== one));
  return {
    busy: count > 0,
    left,
    discard,
    paste: (block) => {
      const isReplaced = ({ block: before, unmatched }: Left) =>
        before.target === block.target && before.column === block.column && unmatched.length === 0;
      setLeft((before) => before.filter((one) => !isReplaced(one)));
      enqueue(block);
    },
    again: (one, mark) => {
      discard(one);
      enqueue(one.block, mark ? { decimal_mark: mark } : {});
    },
    settle: (one, { name, typed }, target) => {
      const unmatched = one.unmatched.filter((each) => each.name !== name);
      setLeft((before) =>
        before.flatMap((each) => (each !== one ? [each] : unmatched.length > 0 ? [{ ...one, unmatched }] : [])),
      );
      change((now) => {
        const row: Typed | undefined = now[target];
        return row ? { ...now, [target]: { ...row, ...typed } } : now;
      });
    },
  };
}
