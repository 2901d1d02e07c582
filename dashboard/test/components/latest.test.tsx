// @vitest-environment happy-dom
import { expect, it } from "vitest";
import { useLatest } from "../../src/state/action";
import { drawn } from "./drawn";

it("goes on with the latest value after a call that failed", async () => {
  const called: number[] = [];
  let failFirst: (error: Error) => void = () => undefined;
  const act = (value: number) => {
    called.push(value);
    return value === 1 ? new Promise<void>((_, reject) => (failFirst = reject)) : Promise.resolve();
  };
  let run: (value: number) => void = () => undefined;
  let problem: unknown;
  function Caller() {
    const latest = useLatest(act);
    run = latest.run;
    problem = latest.problem;
    return null;
  }
  await drawn(<Caller />);
  run(1);
  run(2);
  run(3);
  failFirst(new Error("away"));
  await new Promise((done) => setTimeout(done, 30));
  expect(called).toEqual([1, 3]);
  expect(problem).toBeNull();
});
