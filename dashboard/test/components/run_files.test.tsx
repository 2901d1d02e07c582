// @vitest-environment happy-dom
import { describe, expect, it, vi } from "vitest";
import { api } from "../../src/api/client";
import type { RunResult } from "../../src/api/types";
import type { RunContext } from "../../src/views/run_context";
import { RunFiles } from "../../src/views/use";
import { drawn, press, settled } from "./drawn";

const done = {
  note: "checked",
  supersedes: null,
  run_id: "r1",
  key_id: "0123456789",
  key_name: "Dr. Key",
  authorised_at: "2026-11-21T09:05:00Z",
  content_hash: "",
  customer: null,
  received_on: null,
  number: 1,
  pdf_sha256: "ab12",
};
const session = (role: "admin" | "viewer" | null) => async () => ({
  access: "keys" as const,
  key_id: null,
  key_name: role && "Dr. Key",
  role,
  ends_at: null,
});

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
    vi.spyOn(api, "authorisations").mockResolvedValue({ items: [] });
    vi.spyOn(api, "session").mockImplementation(session("viewer"));
    const sure = vi.fn().mockReturnValue(false);
    vi.stubGlobal("confirm", sure);
    const root = await drawn(<Files verdict="do_not_use" />);
    await settled(() => {});
    const model = root.querySelector("a[href*='model.mjcf']");
    expect(model?.getAttribute("href")).toContain("accept_verdict=do_not_use");
    const click = new MouseEvent("click", { cancelable: true, bubbles: true });
    model?.dispatchEvent(click);
    expect(click.defaultPrevented).toBe(true);
    expect(sure).toHaveBeenCalledOnce();
    vi.unstubAllGlobals();
  });

  it("links the report and each format", async () => {
    vi.spyOn(api, "authorisations").mockResolvedValue({ items: [] });
    vi.spyOn(api, "session").mockImplementation(session("viewer"));
    const root = await drawn(<Files verdict="use" />);
    await settled(() => {});
    const links = [...root.querySelectorAll("a")].map((link) => link.getAttribute("href"));
    for (const name of [
      "report.pdf",
      "report.html",
      "model.csv",
      "model.xlsx",
      "model.mjcf",
      "model.sdf",
      "model.urdf",
    ])
      expect(links).toContain(`/v1/jobs/r1/files/${name}`);
    expect(root.textContent).toContain("marked as a draft");
    expect(root.querySelector("button")).toBeNull();
  });

  it("lets admins authorise, and says who did", async () => {
    const list = vi
      .spyOn(api, "authorisations")
      .mockResolvedValueOnce({ items: [] })
      .mockResolvedValue({ items: [done] });
    vi.spyOn(api, "session").mockImplementation(session("admin"));
    const authorise = vi.spyOn(api, "authorise").mockResolvedValue(done);
    const root = await drawn(<Files verdict="use" />);
    await settled(() => {});
    await press(root, "Authorise the report");
    await settled(() => {});
    expect(authorise).not.toHaveBeenCalled();
    expect(root.textContent).toContain("under the name of your key, Dr. Key");
    const shown = [...root.querySelectorAll("a")].map((link) => link.getAttribute("href"));
    expect(shown).toContain("/v1/jobs/r1/files/report.html?draft=true");
    await press(root, "Issue the report");
    await settled(() => {});
    expect(authorise).toHaveBeenCalledWith("r1", { note: null, customer: null, received_on: null });
    expect(list).toHaveBeenCalledTimes(2);
    expect(root.textContent).toContain("Report authorised by Dr. Key");
    expect(root.textContent).toContain("checked");
    const issued = [...root.querySelectorAll("a")].map((link) => link.getAttribute("href"));
    expect(issued).toContain("/v1/jobs/r1/files/issued-1.pdf");
    expect(root.textContent).not.toContain("Issue the report");
  });
});
