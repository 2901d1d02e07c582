// @vitest-environment happy-dom
import { describe, expect, it, vi } from "vitest";
import { lazy } from "../../src/components/basics";
import { drawn, settled } from "./drawn";

const Hello = ({ name }: { name: string }) => <p>hello {name}</p>;

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
});
