// @vitest-environment happy-dom
import { expect, it, vi } from "vitest";
import { Palette } from "../../src/features/palette/view";
import { drawn } from "./drawn";

const taken = vi.fn();
vi.mock(import("../../src/features/palette/entries"), async (original) => ({
  ...(await original()),
  foundEntries: async (typed: string) => [{ kind: "robot" as const, name: typed, run: () => taken(typed) }],
}));

it("waits for the search where Enter comes before it has ended", async () => {
  HTMLDialogElement.prototype.showModal = vi.fn();
  const root = await drawn(<Palette close={() => undefined} />);
  const field = root.querySelector("input") as HTMLInputElement;
  field.value = "KR 210";
  field.dispatchEvent(new Event("input", { bubbles: true }));
  await new Promise((done) => setTimeout(done, 10));
  root.querySelector("form")?.dispatchEvent(new Event("submit", { bubbles: true, cancelable: true }));
  expect(taken).not.toHaveBeenCalled();
  await vi.waitFor(() => expect(taken).toHaveBeenCalledExactlyOnceWith("KR 210"));
});
