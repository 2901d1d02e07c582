// @vitest-environment happy-dom
import { render } from "preact";
import { expect, it } from "vitest";
import { useDraft } from "../../src/state/session";

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
