// @vitest-environment happy-dom
import { beforeEach, describe, expect, it, vi } from "vitest";
import { actionsOfPage, matches, ownEntries } from "../../src/features/palette/entries";

describe("the command palette", () => {
  beforeEach(() => {
    document.body.innerHTML = `<main><div class="head"><div class="actions">
      <a href="#/x">PDF report</a><details><button>JSON</button><button disabled>Repeat</button></details>
    </div></div><nav class="tabs"><a href="#/y">Deflection</a></nav></main>`;
  });

  it("offers what the head of the view can do, what is folded away, too", () => {
    expect(actionsOfPage().map(({ name }) => name)).toEqual(["PDF report", "JSON", "Deflection"]);
  });

  it("does what the button does", () => {
    const clicked = vi.fn();
    document.querySelector("button")?.addEventListener("click", clicked);
    ownEntries(actionsOfPage(), "js")[0]?.run();
    expect(clicked).toHaveBeenCalledOnce();
  });

  it("finds by words in any order, and the page's own before the views", () => {
    expect(matches("KR 240 cell 12", "12 kr")).toBe(true);
    expect(matches("KR 240 cell 12", "13 kr")).toBe(false);
    expect(ownEntries(actionsOfPage(), "")[0]?.name).toBe("PDF report");
    ownEntries([], "compare").forEach(({ run }) => run());
    expect(location.hash).toBe("#/compare/methods");
    expect(ownEntries([], "robot").map(({ kind }) => kind)).toEqual(["view", "view"]);
  });
});
