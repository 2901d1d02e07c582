// @vitest-environment happy-dom
import { describe, expect, it } from "vitest";
import { Estimate, EstimateBar } from "../../src/components/estimate";
import { shownChange, shownEstimate, widthText } from "../../src/lib/estimate";
import { drawn } from "./drawn";

const lookOf = (root: HTMLElement): string => root.querySelector(".estimate-bar")?.getAttribute("class") ?? "none";

describe("an estimate", () => {
  it("has its interval, and a bar against ± 20 % where no goal is stated", async () => {
    const root = await drawn(<Estimate of={shownEstimate(3.07, [2.97, 3.18])} unit="µm" />);
    expect(root.textContent).toBe("3.070 µm (2.970 … 3.180)".replaceAll(" … ", "\u00a0…\u00a0"));
    expect(lookOf(root)).toContain("narrow");
    expect(lookOf(await drawn(<Estimate of={shownEstimate(3, [2, 4])} />))).toContain("beyond");
    expect(lookOf(await drawn(<Estimate of={shownEstimate(3, [2, 4])} goal={0.5} />))).toContain("narrow");
  });

  it("is not bold, and its bar grey, where it must not be used", async () => {
    const root = await drawn(<Estimate of={shownEstimate(3.07, [2.97, 3.18], true)} />);
    expect(root.querySelector("b")).toBeNull();
    expect(lookOf(root)).toContain("grey");
  });

  it("has an open bar above a lower limit, and none without a number", async () => {
    const limit = { ...shownEstimate(null, null), limit: "> 3.1" };
    const root = await drawn(<Estimate of={limit} />);
    expect(root.querySelector("b")?.textContent).toBe("> 3.1");
    expect(lookOf(root)).toContain("open");
    expect(lookOf(await drawn(<Estimate of={shownEstimate(null, null)} />))).toBe("none");
    const bar = (await drawn(<EstimateBar of={limit} />)).querySelector("rect");
    expect([bar?.getAttribute("x"), bar?.getAttribute("width")]).toEqual(["22", "22"]);
  });

  it("says its width in per cent where there is little room", async () => {
    const root = await drawn(<Estimate of={shownEstimate(3, [2.7, 3.3])} brief bare />);
    expect(root.textContent).toBe("3.00 ± 10\u00a0%");
    expect(widthText(18)).toBe("± > 100\u00a0%");
  });

  it("of a change has its sign", () => {
    expect(shownChange(0.12, 0.02).value).toBe("+12.0");
    expect(shownChange(-0.133, null).value).toBe("\u221213.3");
  });
});
