// @vitest-environment happy-dom
import { render } from "preact";
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import type { LiveState, Observation } from "../../src/api/types";
import { sendReadings, useWaiting, type Waits, waitingOf } from "../../src/features/measure/readings";
import { answering, drawn, settled } from "./drawn";

const STATE = { state: "measuring", revision: 1, readings: [], warnings: [] } as unknown as LiveState;
const reading = (label: string) => ({ label, joints: [0], force: [0, 0, -9], readings: [] }) as unknown as Observation;

let reached = true;
let posted: string[] = [];
let waits: Waits;
let sets = 0;

/** An open set of its own, shown anew. */
async function shown(id = `set-${++sets}`): Promise<{ id: string; root: HTMLElement }> {
  const Harness = () => {
    waits = useWaiting(id);
    return <p>{waits.waiting.map(({ observation }) => observation.label).join(" ")}</p>;
  };
  return { id, root: await drawn(<Harness />) };
}

beforeEach(() => {
  [reached, posted] = [true, []];
  answering(({ path, body }) => {
    if (!reached) throw new TypeError("Failed to fetch");
    posted.push(`${path} ${body?.["label"]}`);
    return { ...STATE, revision: 1 + posted.length };
  });
});
afterEach(() => {
  vi.unstubAllGlobals();
  vi.restoreAllMocks();
  localStorage.clear();
});

/** Storage as a browser has it that stores nothing. */
const REFUSALS: Record<string, () => void> = {
  full: () =>
    vi.stubGlobal("localStorage", {
      getItem: () => null,
      removeItem: () => undefined,
      clear: () => undefined,
      setItem: () => {
        throw new DOMException("full", "QuotaExceededError");
      },
    }),
  "switched off": () =>
    vi.stubGlobal(
      "localStorage",
      new Proxy({} as Storage, {
        get: (_, name) => {
          if (name === "clear") return () => undefined;
          throw new DOMException("off", "SecurityError");
        },
        ownKeys: () => {
          throw new DOMException("off", "SecurityError");
        },
      }),
    ),
};

describe("readings of an open set", () => {
  it("are sent from a page on plain HTTP, where the browser makes no UUID", async () => {
    const { getRandomValues } = globalThis.crypto;
    vi.stubGlobal("crypto", { getRandomValues: getRandomValues.bind(globalThis.crypto) });
    const { id } = await shown();
    await settled(() => sendReadings(id, [reading("m01"), reading("m02")]));
    expect(posted).toEqual(["m01", "m02"].map((label) => `/v1/measurement-sets/${id}/observations ${label}`));
    expect(waits.waiting).toEqual([]);
  });

  it("have keys in the order in which they came, each its own", async () => {
    reached = false;
    const { id } = await shown();
    const labels = Array.from({ length: 12 }, (_, i) => `m${i}`);
    await settled(() => sendReadings(id, labels.map(reading)));
    expect(waitingOf(id).map(({ observation }) => observation.label)).toEqual(labels);
    expect(waits.unstored).toBe(false);
  });

  for (const [refusal, refuse] of Object.entries(REFUSALS))
    it(`wait in the page where storage is ${refusal}, and are sent when the service is back`, async () => {
      refuse();
      reached = false;
      const { id, root } = await shown();
      await settled(() => sendReadings(id, [reading("m01")]));
      await settled(() => sendReadings(id, [reading("m02")]));
      expect(waits.away).toBe(true);
      expect(waits.unstored).toBe(true);
      await settled(() => render(null, root)); // another view of the page
      await shown(id);
      expect(waits.waiting.map(({ observation }) => observation.label)).toEqual(["m01", "m02"]);
      const leave = new Event("beforeunload", { cancelable: true });
      window.dispatchEvent(leave);
      expect(leave.defaultPrevented).toBe(true);
      reached = true;
      await vi.waitFor(() => expect(posted.map((one) => one.split(" ")[1])).toEqual(["m01", "m02"]), 5_000);
      await settled(() => {});
      expect(waits.waiting).toEqual([]);
      expect(waits.unstored).toBe(false);
    });
});
