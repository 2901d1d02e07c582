/** A word of the field with its meaning on tap, under the pointer, or by keyboard. */
import { tip } from "../charts/tip";
import { text } from "../i18n";

type Known = keyof typeof text.glossary;

export function Term({ of, children }: { of: Known; children?: string }) {
  const shown = children ?? text.glossary[of][0];
  return (
    <span class="term" tabIndex={0} {...tip([...text.glossary[of]])}>
      {shown}
    </span>
  );
}
