// @vitest-environment happy-dom
import { render } from "preact";
import { expect, it } from "vitest";
import { act } from "preact/test-utils";
import { forgetTyped, useDraft, useTypedValue } from "../../src/state/session";

let type: (value: string) => void = () => {};

function Form() {
  const [{ force }, change] = useDraft<{ force: string }>("test", { force: "" });
  type = (value) => change({ force: value });
  return <p>{force}</p>;
}

it("keeps what was typed in the frame in which the view is left", async () => {
  const root = document.createElement("div");
  render(<Form />, root);
  type("-777");
  await Promise.resolve(); // it is drawn, and no frame has passed
  expect(root.textContent).toBe("-777");
  render(null, root);
  expect(sessionStorage.getItem("jointstiff.form.test")).toContain("-777");
});

let take: (value: string) => void = () => {};

function Field({ name }: { name: string }) {
  const [value, set] = useTypedValue(name, "start");
  take = set;
  return <p>{value}</p>;
}

it("keeps a field of each form for itself, and forgets what was sent", async () => {
  const root = document.createElement("div");
  const shown = async (name: string) => {
    await act(async () => render(<Field name={name} />, root));
    return root.textContent;
  };
  expect(await shown("one")).toBe("start");
  await act(async () => take("typed"));
  expect(await shown("two")).toBe("start");
  expect(await shown("one")).toBe("typed");
  render(null, root);
  forgetTyped("one");
  expect(await shown("one")).toBe("start");
  expect(sessionStorage.getItem("jointstiff.form.two")).toBeNull();
});
