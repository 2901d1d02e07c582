// @vitest-environment happy-dom
import { describe, expect, it, vi } from "vitest";
import type { RunResult } from "../../src/api/types";
import { QuestionDialog } from "../../src/components/question";
import type { RunContext } from "../../src/state/run_context";
import { RunFiles } from "../../src/features/use/forms";
import { drawn, press, settled } from "./drawn";

const USE = { verdict: "use" as const, reasons: [], joints_identified: 6, joint_count: 6, headline: null, notes: [] };

const Files = ({ verdict }: { verdict: "use" | "do_not_use" }) => (
  <RunFiles
    context={{ run: { id: "r1" } } as RunContext}
    result={{ assessment: { ...USE, verdict } } as unknown as RunResult}
    query={new URLSearchParams()}
  />
);

describe("files of a run", () => {
  it("asks before a model of a run that is not to be used goes out", async () => {
    const root = await drawn(
      <>
        <Files verdict="do_not_use" />
        <QuestionDialog />
      </>,
    );
    const leave = vi.spyOn(location, "assign").mockImplementation(() => undefined);
    await settled(() => {});
    const model = root.querySelector("a[href*='model.mjcf']");
    expect(model?.getAttribute("href")).toContain("accept_verdict=do_not_use");
    const click = new MouseEvent("click", { cancelable: true, bubbles: true });
    await settled(() => model?.dispatchEvent(click));
    expect(click.defaultPrevented).toBe(true);
    await press(root, "Cancel");
    expect(leave).not.toHaveBeenCalled();
    await settled(() => model?.dispatchEvent(click));
    await press(root, "Continue");
    expect(leave.mock.calls[0]?.[0]).toContain("model.mjcf");
  });

  it("links the report and each format", async () => {
    const root = await drawn(<Files verdict="use" />);
    await settled(() => {});
    const links = [...root.querySelectorAll("a")].map((link) => link.getAttribute("href"));
    for (const name of ["report.pdf", "report.html", "model.csv", "model.xlsx", "model.mjcf"])
      expect(links).toContain(`/v1/jobs/r1/files/${name}`);
  });
});
