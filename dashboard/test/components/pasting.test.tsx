// @vitest-environment happy-dom
import { useRef, useState } from "preact/hooks";
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import type { Rows } from "../../src/features/measure/live";
import { type Pasting, usePasting } from "../../src/features/measure/pasting";
import { answering, drawn, settled } from "./drawn";

const BLANK: Rows = { P1: { unloaded: "", loaded: "" }, P2: { unloaded: "", loaded: "" } };
const read = (target: string, unloaded: number[], loaded = unloaded) => ({ target, unloaded, loaded });
const answerOf = (...readings: unknown[]) => ({
  faults: [],
  missing: [],
  measurement_set: { observations: [{ readings }] },
});
const refusal = (option: string | null) => ({
  faults: [{ line: 2, reason: "'1,234' is a thousand or a fraction", remedy: "say it", option }],
  missing: [],
  measurement_set: null,
});

/** Requests that the service has not answered yet, oldest first, with their options. */
let open: { options: Record<string, unknown>; answer: (value: unknown) => void; fail: () => void }[] = [];
let rows: Rows;
let change: (by: (rows: Rows) => Rows) => void;
let pasting: Pasting;

function Harness() {
  const [shown, setShown] = useState(BLANK);
  const latest = useRef(BLANK);
  change = (by) => {
    latest.current = by(latest.current);
    setShown(latest.current);
  };
  rows = shown;
  pasting = usePasting(shown, change);
  return <p>{JSON.stringify(shown)}</p>;
}

beforeEach(async () => {
  open = [];
  answering(
    ({ body }) =>
      new Promise((answer, fail) =>
        open.push({ options: body ?? {}, answer, fail: () => fail(new TypeError("Failed to fetch")) }),
      ),
  );
  await drawn(<Harness />);
});
afterEach(() => vi.unstubAllGlobals());

const paste = (text: string, target = "P1", column: "unloaded" | "loaded" = "unloaded") =>
  settled(() => pasting.paste({ target, column, text }));
const answer = (value: unknown) => settled(() => open.shift()?.answer(value));

describe("a block that is pasted into a live reading", () => {
  it("leaves what was typed into other boxes before the answer came", async () => {
    await paste("P1;1;2;3");
    expect(pasting.busy).toBe(true);
    await settled(() => change((now) => ({ ...now, P2: { unloaded: "7 8 9", loaded: "" } })));
    await answer(answerOf(read("P1", [1, 2, 3])));
    expect(rows).toEqual({ P1: { unloaded: "1 2 3", loaded: "" }, P2: { unloaded: "7 8 9", loaded: "" } });
    expect(pasting.busy).toBe(false);
  });

  it("is read after one that is being read, and both are taken", async () => {
    await paste("P1;1;2;3");
    await paste("P2;4;5;6", "P2");
    expect(open).toHaveLength(1); // one after the other
    await answer(answerOf(read("P1", [1, 2, 3])));
    await answer(answerOf(read("P2", [4, 5, 6])));
    expect(rows).toEqual({ P1: { unloaded: "1 2 3", loaded: "" }, P2: { unloaded: "4 5 6", loaded: "" } });
  });

  it("is kept while the service is away, and read again by one tap", async () => {
    await paste("P1;1;2;3");
    await paste("P2;4;5;6", "P2");
    await settled(() => open.shift()?.fail());
    await settled(() => open.shift()?.fail());
    expect(pasting.left.map(({ block, problem }) => [block.text, problem?.status])).toEqual([
      ["P1;1;2;3", 0],
      ["P2;4;5;6", 0],
    ]);
    const [first] = pasting.left;
    await settled(() => first && pasting.again(first));
    await answer(answerOf(read("P1", [1, 2, 3])));
    expect(rows["P1"]?.unloaded).toBe("1 2 3");
    expect(pasting.left.map(({ block }) => block.text)).toEqual(["P2;4;5;6"]);
  });

  it("asks for the decimal mark that it does not show, and is read by it", async () => {
    await paste("123,456 1,234 5,678\n1,000 2,000 3,000");
    expect(open[0]?.options).not.toHaveProperty("decimal_mark");
    await answer(refusal("decimal_mark"));
    const [left] = pasting.left;
    expect(left?.asksForMark).toBe(true);
    await settled(() => left && pasting.again(left, "comma"));
    expect(open[0]?.options).toMatchObject({ decimal_mark: "comma" });
    await answer(answerOf(read("P1", [123.456, 1.234, 5.678]), read("P2", [1, 2, 3])));
    expect(rows["P2"]?.unloaded).toBe("1 2 3");
    expect(pasting.left).toEqual([]);
  });

  it("that is not understood is kept until its box is filled by another block", async () => {
    await paste("P1;x;2;3");
    await answer(refusal(null));
    expect(pasting.left[0]).toMatchObject({ asksForMark: false, block: { text: "P1;x;2;3" } });
    await paste("P1;1;2;3");
    expect(pasting.left).toEqual([]);
  });

  it("puts an unknown name where it is told to, beside what was typed meanwhile", async () => {
    await paste("Q;1;2;3\nR;4;5;6");
    await answer(answerOf(read("Q", [1, 2, 3]), read("R", [4, 5, 6])));
    const [left] = pasting.left;
    const [first, second] = left?.unmatched ?? [];
    await settled(() => change((now) => ({ ...now, P2: { unloaded: "", loaded: "9 9 9" } })));
    await settled(() => left && first && pasting.settle(left, first, "P2"));
    expect(rows["P2"]).toEqual({ unloaded: "1 2 3", loaded: "9 9 9" });
    const [rest] = pasting.left;
    expect(rest?.unmatched).toEqual([second]);
    await settled(() => rest && second && pasting.settle(rest, second, "\u0000"));
    expect(pasting.left).toEqual([]);
    expect(rows["P1"]).toEqual({ unloaded: "", loaded: "" });
  });
});
