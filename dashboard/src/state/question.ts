/** Questions that the page asks in a dialog of its own: whether to go on, or for a text. */
import { useEffect, useState } from "preact/hooks";
import { listen, news, tell } from "../lib/events";

export interface Question {
  /** Paragraphs are apart by an empty line. */
  message: string;
  /** What a text begins with; null if none is asked for. */
  text: string | null;
  /** Called once, with the text; null if one does not want to go on. */
  answer: (given: string | null) => void;
}

let waiting: Question[] = [];

function put(next: Question[]): void {
  waiting = next;
  tell("question");
}

/** Ask for a text; null if the dialog is left. Questions wait for each other. */
export const askFor = (message: string, text: string | null): Promise<string | null> =>
  new Promise((resolve) => {
    const question: Question = {
      message,
      text,
      answer: (given) => {
        put(waiting.filter((one) => one !== question));
        resolve(given);
      },
    };
    put([...waiting, question]);
  });

/** Ask whether to go on. */
export const sure = async (message: string): Promise<boolean> => (await askFor(message, null)) !== null;

/** The question that is asked now. */
export const currentQuestion = (): Question | null => waiting[0] ?? null;

export function useQuestion(): Question | null {
  const [asked, set] = useState(currentQuestion);
  useEffect(() => listen(news, { question: () => set(currentQuestion) }), []);
  return asked;
}
