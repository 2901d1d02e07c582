// @vitest-environment happy-dom
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import type { Observation } from "../../src/api/types";
import { answering, settled } from "./drawn";

const reading = (label: string) => ({ label }) as Observation;

let away = true;
let posted: unknown[] = [];

beforeEach(() => {
  [away, posted] = [true, []];
  answering(({ method, body }) => {
    if (method !== "POST") return null;
    if (away) throw new TypeError("Failed to fetch");
    const label = String(body?.["label"]);
    posted.push(label);
    return { state: "measuring", revision: posted.length };
  });
});
afterEach(() => localStorage.clear());

/** The page as it is loaded, with nothing but what this device keeps. */
async function loaded() {
  vi.resetModules();
  const page = await import("../../src/features/measure/readings");
  page.startReadings();
  return page;
}

const keptKeys = () => Object.keys(localStorage).filter((name) => name.startsWith("jointstiff.reading."));

it("keeps the readings of two tabs that are away from the network", async () => {
  const [one, two] = [await loaded(), await loaded()];
  await settled(() => one.sendReadings("set", [reading("a")]));
  await settled(() => two.sendReadings("set", [reading("b")]));
  await settled(() => one.sendReadings("set", [reading("c")]));
  expect(keptKeys()).toHaveLength(3);
});

it("sends what waits after the page was loaded again, in order and without the view of the set", async () => {
  const before = await loaded();
  await settled(() => before.sendReadings("set", ["a", "b", "c"].map(reading)));
  expect(posted).toEqual([]);
  const after = await loaded();
  expect(after.waitingOf("set").map(({ observation }) => observation.label)).toEqual(["a", "b", "c"]);
  away = false;
  await vi.waitFor(() => expect(keptKeys()).toEqual([]), 8_000);
  expect([...new Set(posted)]).toEqual(["a", "b", "c"]);
});

it("keeps why the service refused a reading, and sends those behind it", async () => {
  vi.stubGlobal("fetch", async (request: Request) => {
    const { label } = (await request.json()) as Observation;
    if (label !== "a") return new Response(JSON.stringify({ state: "measuring", revision: 1 }));
    const problem = { title: "Another reading has this label", detail: "taken", status: 409 };
    return new Response(JSON.stringify(problem), { status: 409 });
  });
  const before = await loaded();
  await settled(() => before.sendReadings("set", ["a", "b"].map(reading)));
  await vi.waitFor(() => expect(keptKeys()).toHaveLength(1));
  const after = await loaded();
  const [waiting] = after.waitingOf("set");
  expect(waiting?.observation.label).toBe("a");
  expect(waiting?.problem?.detail).toBe("taken");
  await settled(() => after.discardReading("set", "a"));
  expect(keptKeys()).toEqual([]);
});
