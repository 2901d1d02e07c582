// @vitest-environment happy-dom
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { remember } from "../../src/state/kept";
import { CorrectForm } from "../../src/features/use/forms";
import { drawn, press, settled } from "./drawn";

const remedy = "if 'GRIPPER' does neither, state `trust_routines`, or name the routine in `leave_alone`: ['GRIPPER']";
const problem = {
  type: "urn:jointstiff:problem:invalid-file",
  title: "The file is not understood",
  status: 422,
  detail: "'cell.src', line 9: 'GRIPPER' is unknown",
  errors: [
    { where: "cell.src, line 9", reason: "'GRIPPER' is unknown", remedy },
    { where: "cell.src, line 12", reason: "'H50' is unknown", remedy: remedy.replace("GRIPPER", "H50") },
  ],
};
const context = { run: { id: "r1" }, robot: { id: "a1", joints: [] } } as never;
const posted: Record<string, unknown>[] = [];

beforeEach(() => {
  posted.length = 0;
  remember("form.corrections/r1", { accuracy_option: "off", force: [0, 0, -100] }, "sessionStorage");
  vi.stubGlobal("fetch", async (request: Request) => {
    const isPost = request.method === "POST";
    const options = isPost ? (JSON.parse(String((await request.formData()).get("options"))) as (typeof posted)[0]) : {};
    if (isPost) posted.push(options);
    const refused = isPost && options["trust_routines"] !== true;
    const headers = { "Content-Type": refused ? "application/problem+json" : "application/json" };
    const schemas = { CorrectionRequest: {}, ProgramFrame: {} };
    const answer = refused
      ? problem
      : isPost
        ? { id: "p1", kind: "correction" }
        : { components: { schemas }, items: [] };
    return new Response(JSON.stringify(answer), { status: refused ? 422 : 200, headers });
  });
});
afterEach(() => {
  vi.unstubAllGlobals();
  sessionStorage.clear();
});

const question = (root: HTMLElement) =>
  [...root.querySelectorAll("label")].filter((label) => label.textContent?.startsWith("Routines of other files"));

it("asks one question for all routines of other files, and sends its answer", async () => {
  const root = await drawn(<CorrectForm context={context} />);
  const input = await vi.waitFor(() => {
    const found = root.querySelector<HTMLInputElement>("input[type=file]");
    if (!found) throw new Error(root.innerHTML);
    return found;
  });
  Object.defineProperty(input, "files", { value: [new File(["DEF cell()\nEND\n"], "cell.src")] });
  await settled(() => input.dispatchEvent(new Event("change", { bubbles: true })));
  expect(question(root)).toHaveLength(0);
  await press(root, "Correct");
  await vi.waitFor(() => expect(question(root)).toHaveLength(1));
  expect(posted).toHaveLength(1);
  expect(posted[0]).not.toHaveProperty("trust_routines");
  const [asked] = question(root);
  expect(asked?.textContent).toBe("Routines of other files move neither frames nor points: GRIPPER, H50");
  await settled(() => asked?.querySelector("input")?.click());
  await press(root, "Correct");
  await vi.waitFor(() => expect(posted).toHaveLength(2));
  expect(posted[1]).toMatchObject({ run_id: "r1", trust_routines: true });
});
