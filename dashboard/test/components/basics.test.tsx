// @vitest-environment happy-dom
import { useState } from "preact/hooks";
import { describe, expect, it, vi } from "vitest";
import { ApiError } from "../../src/api/problem";
import type { Problem, Finding } from "../../src/api/types";
import { Boundary, ProblemNote, Warnings } from "../../src/components/basics";
import { useAction } from "../../src/state/action";
import { send, useQuery } from "../../src/state/query";
import { drawn, press, settled } from "./drawn";

const warning = (part: Partial<Finding>): Finding => ({
  code: "target_moved",
  weight: "use_with_care",
  where: null,
  observation: null,
  message: "a target moved",
  remedy: "measure it again",
  action: null,
  ...part,
});

describe("warnings", () => {
  it("says the remedy of one kind once", async () => {
    const root = await drawn(<Warnings warnings={[warning({ message: "c1" }), warning({ message: "c2" })]} />);
    expect(root.textContent?.split("measure it again")).toHaveLength(2);
    expect(root.textContent).toContain("c1");
    expect(root.textContent).toContain("c2");
  });

  it("shows what stands between backticks as code, and a field by its name", async () => {
    const root = await drawn(<Warnings warnings={[warning({ message: "omit `noise` or `<b>`", remedy: "a ` b" })]} />);
    expect([...root.querySelectorAll("code")].map((code) => code.textContent)).toEqual(["<b>"]);
    expect(root.textContent).toContain("Omit “noise” or <b>");
    expect(root.textContent).toContain("a ` b");
  });
});

function Starter({ act: given }: { act: () => Promise<unknown> }) {
  const action = useAction(given);
  return (
    <>
      <button type="button" onClick={action.run}>
        go
      </button>
      {action.problem && <ProblemNote problem={action.problem} />}
    </>
  );
}

describe("an action", () => {
  it("starts once however often it is tapped", async () => {
    let starts = 0;
    const root = await drawn(<Starter act={() => new Promise(() => starts++)} />);
    await press(root, "go");
    await press(root, "go");
    expect(starts).toBe(1);
  });

  it.each([
    [new ApiError({ title: "Refused", detail: "no such set" } as Problem), "No such set"],
    [new TypeError("x is undefined"), "x is undefined"],
  ])("shows %s", async (error, shown) => {
    const root = await drawn(<Starter act={() => Promise.reject(error)} />);
    await press(root, "go");
    expect(root.querySelector("[role=alert]")?.textContent).toContain(shown);
  });
});

describe("a refusal", () => {
  it("says a fault once", async () => {
    const [where, reason] = ["units.length", "must be 'm' or 'mm'"];
    const detail = `1 fault; first: ${where}: ${reason}`;
    const problem = {
      title: "no schema",
      detail,
      where,
      remedy: "see docs",
      errors: [{ where, reason, remedy: null }],
    };
    const root = await drawn(<ProblemNote problem={problem} />);
    for (const once of ["unit of length", reason, "See docs"]) expect(root.textContent?.split(once)).toHaveLength(2);
  });
});

describe("a view that fails", () => {
  it("says so", async () => {
    function Broken(): never {
      throw new RangeError("no joints");
    }
    const root = await drawn(
      <Boundary>
        <Broken />
      </Boundary>,
    );
    expect(root.querySelector("[role=alert]")?.textContent).toContain("no joints");
  });
});

function Listing({ asked }: { asked: () => Promise<string> }) {
  const { data, problem } = useQuery({ queryKey: ["listing"], queryFn: asked });
  return <p>{data ?? problem?.title ?? "loading"}</p>;
}

function Two({ asked }: { asked: () => Promise<string> }) {
  const [second, show] = useState(false);
  return (
    <>
      <Listing asked={asked} />
      {second && <Listing asked={asked} />}
      <button type="button" onClick={() => show(true)}>
        another
      </button>
    </>
  );
}

describe("server state", () => {
  it("is asked for once by two views, and again when something was changed", async () => {
    let asked = 0;
    const root = await drawn(<Two asked={async () => `answer ${++asked}`} />);
    await settled(() => {});
    await press(root, "another");
    expect([...root.querySelectorAll("p")].map((p) => p.textContent)).toEqual(["answer 1", "answer 1"]);
    await settled(() => void send(async () => "changed"));
    await settled(() => {});
    expect([...root.querySelectorAll("p")].map((p) => p.textContent)).toEqual(["answer 2", "answer 2"]);
    expect(asked).toBe(2);
  });

  it("comes by itself when the service is back", async () => {
    vi.useFakeTimers({ toFake: ["setInterval", "clearInterval"] });
    let away = true;
    const answer = async () => {
      if (away) throw new ApiError({ title: "The service cannot be reached", status: 0 } as Problem);
      return "back";
    };
    const root = await drawn(<Listing asked={answer} />);
    await settled(() => {});
    expect(root.textContent).toBe("The service cannot be reached");
    away = false;
    await settled(() => vi.advanceTimersByTime(5_000));
    await settled(() => {});
    expect(root.textContent).toBe("back");
    vi.useRealTimers();
  });
});
