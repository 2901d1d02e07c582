/** The dialog in which the page asks. */
import { useEffect, useId, useRef, useState } from "preact/hooks";
import { text } from "../words";
import { type Question, useQuestion } from "../state/question";
import { Button } from "./basics";

export function QuestionDialog() {
  const question = useQuestion();
  return question && <Asked key={question.message} question={question} />;
}

function Asked({ question: { message, text: given, answer } }: { question: Question }) {
  const dialog = useRef<HTMLDialogElement>(null);
  const [typed, setTyped] = useState(given ?? "");
  const id = useId();
  useEffect(() => {
    const before = document.activeElement;
    dialog.current?.showModal();
    dialog.current?.querySelector("input")?.select();
    return () => before instanceof HTMLElement && before.focus();
  }, []);
  const [first = "", ...others] = message.split("\n\n");
  return (
    <dialog
      class="card question"
      ref={dialog}
      aria-labelledby={id}
      onCancel={(event) => {
        event.preventDefault(); // the question ends, and with it the dialog
        answer(null);
      }}
    >
      <form
        onSubmit={(event) => {
          event.preventDefault();
          answer(typed);
        }}
      >
        {given === null ? (
          <p id={id}>
            <b>{first}</b>
          </p>
        ) : (
          <label class="field">
            <span id={id}>{first}</span>
            <input type="text" value={typed} maxLength={200} onInput={(event) => setTyped(event.currentTarget.value)} />
          </label>
        )}
        {others.map((paragraph) => (
          <p>{paragraph}</p>
        ))}
        <div class="actions">
          <Button type="submit" look="primary">
            {text.question.yes}
          </Button>
          <Button onClick={() => answer(null)}>{text.question.no}</Button>
        </div>
      </form>
    </dialog>
  );
}
