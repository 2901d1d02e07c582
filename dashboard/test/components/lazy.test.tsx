// @vitest-environment happy-dom
import { describe, expect, it } from "vitest";
import { Boundary } from "../../src/components/boundary";
import { lazy } from "../../src/components/lazy";
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

  it("fails as any other view where its code does not come", async () => {
    const View = lazy<{ name: string }>(() => Promise.reject(new Error("no code")));
    const root = await drawn(
      <Boundary>
        <View name="x" />
      </Boundary>,
    );
    await settled(() => undefined);
    expect(root.textContent).toContain("no code");
  });
});
