// @vitest-environment happy-dom
import { expect, it, vi } from "vitest";
import { api } from "../../src/api/client";
import { useToasts } from "../../src/state/action";
import { OpenCampaigns } from "../../src/views/measure";
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
  const items = [{ id: "s", name: "Simulated campaign", observation_count: 1 }];
  const list = async () => ({ items: items.filter(({ id }) => !deleted.has(id)), next: null });
  vi.spyOn(api.openSets, "list").mockImplementation(list as unknown as typeof api.openSets.list);
  vi.spyOn(api.openSets, "delete").mockImplementation(async (id) => deleted.add(id));
  vi.spyOn(api.openSets, "restore").mockImplementation(async (id) => deleted.delete(id));
  const root = await drawn(
    <>
      <OpenCampaigns />
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
