// @vitest-environment happy-dom
import { act } from "preact/test-utils";
import { afterEach, expect, it, vi } from "vitest";
import { api } from "../../src/api/client";
import type { LiveState, Observation } from "../../src/api/types";
import { type Measuring, useMeasuring, waitingOf } from "../../src/state/measuring";
import { drawn } from "./drawn";

class Source extends EventTarget {
  readyState = 0;
  close() {}
}
vi.stubGlobal("EventSource", Object.assign(Source, { CLOSED: 2 }));

const first = { state: "measuring", revision: 1 } as LiveState;
const reading = (label: string) => ({ label }) as Observation;

/** A tab with the live view of the set. */
async function tab(): Promise<Measuring> {
  let now: Measuring | null = null;
  function View() {
    now = useMeasuring("set", first);
    return null;
  }
  await drawn(<View />);
  if (!now) throw new Error("not drawn");
  return now;
}

afterEach(() => localStorage.clear());

it("keeps the readings of two tabs that are away from the network", async () => {
  vi.spyOn(api.openSets, "observe").mockRejectedValue(new TypeError("Failed to fetch"));
  const [one, two] = [await tab(), await tab()];
  await act(async () => one.send(reading("a")));
  await act(async () => two.send(reading("b")));
  await act(async () => one.send(reading("c")));
  expect(waitingOf("set").map(({ observation }) => observation.label)).toEqual(["a", "b", "c"]);
});

it("sends what waits once the service is back, and then keeps nothing", async () => {
  const observe = vi.spyOn(api.openSets, "observe").mockRejectedValue(new TypeError("Failed to fetch"));
  const one = await tab();
  await act(async () => one.send(reading("a"), reading("b")));
  observe.mockResolvedValue({ ...first, revision: 2 });
  await act(async () => void window.dispatchEvent(new Event("online")));
  await act(async () => new Promise((done) => setTimeout(done, 20)));
  expect(waitingOf("set")).toEqual([]);
});
