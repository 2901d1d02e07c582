import { describe, expect, it, vi } from "vitest";
import { ApiError } from "../src/api/problem";
import { listen, news } from "../src/lib/events";
import { asking } from "../src/state/action";
import { currentQuestion } from "../src/state/question";

const problem = (type: string) => ({
  type: `urn:jointstiff:problem:${type}`,
  title: "",
  status: 422,
  detail: "",
  where: null,
  remedy: null,
  request_id: null,
  errors: [{ where: "all readings", reason: "columns are exchanged", remedy: null }],
});

/** Answer what is asked, and note it. */
function answerNext(asked: string[], said: boolean): void {
  const question = currentQuestion();
  if (!question) return;
  asked.push(question.message);
  question.answer(said ? "" : null);
}

describe("a result not to be used", () => {
  it.each([
    ["not-to-be-used", true, 2],
    ["not-to-be-used", false, 1],
    ["invalid-request", true, 1],
  ])("of %s, said %s, is posted %i times", async (type, said, times) => {
    const asked: string[] = [];
    const end = listen(news, { question: () => answerNext(asked, said) });
    const post = vi
      .fn()
      .mockRejectedValueOnce(new ApiError(problem(type)))
      .mockResolvedValue("made");
    const made = await asking(post).catch(() => "refused");
    expect(post).toHaveBeenCalledTimes(times);
    expect(made).toBe(times === 2 ? "made" : "refused");
    if (times === 2) expect(post).toHaveBeenLastCalledWith({ accept_verdict: "do_not_use" });
    end();
    if (type === "not-to-be-used") expect(asked[0]).toContain("columns are exchanged");
    else expect(asked).toEqual([]);
  });
});
