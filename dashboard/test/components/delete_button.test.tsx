// @vitest-environment happy-dom
import { describe, expect, it, vi } from "vitest";
import { QuestionDialog } from "../../src/components/question";
import { ApiError } from "../../src/api/problem";
import { StoredActions } from "../../src/components/list";
import { drawn, press, settled } from "./drawn";

const refused = new ApiError({
  type: "urn:jointstiff:problem:referenced",
  title: "Other resources refer to it",
  status: 409,
  detail: "2 measurement sets refer to it",
  where: null,
  remedy: "delete those first",
  request_id: null,
  errors: [],
});

describe("deletion of a robot or a set", () => {
  const asked = (remove: () => Promise<unknown>) =>
    drawn(
      <>
        <StoredActions
          of={{ id: "r", name: "KR 240" }}
          api={{ change: remove, delete: remove, restore: async () => {} }}
          list="#/robots"
        />
        <QuestionDialog />
      </>,
    );

  it("asks first", async () => {
    const remove = vi.fn(async () => {});
    const root = await asked(remove);
    await press(root, "Delete");
    await press(root, "Cancel");
    expect(remove).not.toHaveBeenCalled();
    await press(root, "Delete");
    await press(root, "Continue");
    expect(remove).toHaveBeenCalledOnce();
    expect(location.hash).toBe("#/robots");
  });

  it("says why the service refuses", async () => {
    const root = await asked(async () => Promise.reject(refused));
    await press(root, "Delete");
    await press(root, "Continue");
    await settled(() => {});
    expect(root.textContent).toContain("2 measurement sets refer to it");
    expect(root.textContent).toContain("Delete those first");
  });
});
