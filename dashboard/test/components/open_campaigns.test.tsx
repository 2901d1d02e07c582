// @vitest-environment happy-dom
import { expect, it, vi } from "vitest";
import { api } from "../../src/api/calls";
import { useToasts } from "../../src/state/action";
import { OpenCampaigns } from "../../src/features/measure/open_campaigns";
import { drawn, settled } from "./drawn";

function Said() {
  return (
    <>
      {useToasts().map(({ message, action }) => (
        <p>
          {message}
          {action && (
            <button type="button" onClick={action.run}>
              {action.label}
            </button>
          )}
        </p>
      ))}
    </>
  );
}

it("deletes an open live campaign, and restores it", async () => {
  const deleted = new Set<string>();
  const rows = [{ id: "s", name: "Simulated campaign", observation_count: 1 }];
  const list = async () => ({ items: rows.filter(({ id }) => !deleted.has(id)), next: null });
  vi.spyOn(api.sets, "list").mockImplementation(list as unknown as typeof api.sets.list);
  vi.spyOn(api.openSets, "delete").mockImplementation(async (id) => deleted.add(id) as never);
  vi.spyOn(api.openSets, "restore").mockImplementation(async (id) => deleted.delete(id) as never);
  const root = await drawn(
    <>
      <OpenCampaigns as="h2" />
      <Said />
    </>,
  );
  await settled(() => {});
  const click = (what: string) => settled(() => root.querySelector<HTMLElement>(what)?.click());
  await click("[aria-label='Delete Simulated campaign']");
  await settled(() => {});
  expect(root.textContent).not.toContain("1 reading so far");
  expect(root.textContent).toContain("Simulated campaign deleted");
  await click("p button");
  await settled(() => {});
  expect(root.textContent).toContain("1 reading so far");
});
