// @vitest-environment happy-dom
import { act } from "preact/test-utils";
import { describe, expect, it, vi } from "vitest";
import { api } from "../../src/api/calls";
import { lazy } from "../../src/components/basics";
import { drawn, settled } from "./drawn";

const Hello = ({ name }: { name: string }) => <p>hello {name}</p>;

/** Let time pass, and what it brings about. */
const passing = (ms: number) => act(async () => void (await vi.advanceTimersByTimeAsync(ms)));

describe("a view that is loaded when it is shown", () => {
  it("waits for its code once", async () => {
    let loads = 0;
    const View = lazy(async () => {
      loads += 1;
      return Hello;
    });
    const root = await drawn(<View name="first" />);
    await settled(() => undefined);
    expect(root.textContent).toBe("hello first");
    expect((await drawn(<View name="second" />)).textContent).toBe("hello second");
    expect(loads).toBe(1);
  });

  it("says so, and offers to reload where its code does not come", async () => {
    const reload = vi.spyOn(location, "reload").mockImplementation(() => undefined);
    const View = lazy<{ name: string }>(() => Promise.reject(new Error("no code")));
    const root = await drawn(<View name="x" />);
    await settled(() => undefined);
    expect(root.querySelector("h1")?.textContent).toBe("This view could not be loaded");
    root.querySelector<HTMLElement>(".note .button")?.click();
    expect(reload).toHaveBeenCalledOnce();
  });

  it("comes by itself once the service answers again", async () => {
    vi.useFakeTimers();
    const session = vi
      .spyOn(api, "session")
      .mockRejectedValueOnce(new Error("away"))
      .mockResolvedValue({} as never);
    const load = vi.fn().mockRejectedValueOnce(new Error("away")).mockResolvedValue(Hello);
    const View = lazy<{ name: string }>(load);
    const root = await drawn(<View name="again" />);
    await passing(100);
    expect(root.textContent).toContain("could not be loaded");
    await passing(5_000); // still away
    expect(load).toHaveBeenCalledOnce();
    await passing(5_000);
    expect(root.textContent).toBe("hello again");
    expect(session).toHaveBeenCalledTimes(2);
    vi.useRealTimers();
  });

  it("is loaded with the page, once, where its code is that of another service", async () => {
    vi.useFakeTimers();
    const reload = vi.spyOn(location, "reload").mockImplementation(() => undefined);
    reload.mockClear();
    vi.spyOn(api, "session").mockResolvedValue({} as never);
    const View = lazy<{ name: string }>(() => Promise.reject(new Error("no such file")));
    await drawn(<View name="x" />);
    await passing(5_000);
    await drawn(<View name="y" />);
    await passing(5_000);
    expect(reload).toHaveBeenCalledOnce();
    vi.useRealTimers();
  });
});
