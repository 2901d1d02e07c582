/** A vector in three boxes, for a keyboard of numbers. */
import { useLayoutEffect, useState } from "preact/hooks";
import { Button } from "../../components/basics";
import { measureWords } from "./words";

const AXES = ["x", "y", "z"] as const;
/** What a blank box is in the text of a vector that is begun; it is read as no number. */
const BLANK = "·";

const partsOf = (text: string): string[] => {
  const parts = text.split(/[\s;]+/).filter(Boolean);
  return AXES.map((_, i) => (parts[i] === BLANK ? "" : (parts[i] ?? "")));
};

/** The text of three boxes; blank if all of them are. */
export const joined = (parts: readonly string[]): string =>
  parts.every((part) => part.trim() === "") ? "" : parts.map((part) => part.trim() || BLANK).join(" ");

const opposite = (part: string): string => (/^\s*[-\u2212]/.test(part) ? part.replace(/[-\u2212]/, "") : `-${part}`);

/** Changes the sign of the box that is typed into: some keyboards of numbers have no minus. */
export const SignButton = () => (
  <Button
    look="quiet"
    onPointerDown={(event) => event.preventDefault()} // the box keeps the focus
    onClick={() => {
      const box = document.activeElement;
      if (!(box instanceof HTMLInputElement) || !box.closest(".vector")) return;
      box.value = opposite(box.value);
      box.dispatchEvent(new Event("input", { bubbles: true }));
    }}
  >
    {measureWords.sign}
  </Button>
);

interface VectorBoxesProps {
  label: string;
  /** The numbers, separated by spaces. */
  value: string;
  change: (value: string) => void;
  paste: (event: ClipboardEvent) => void;
}

export function VectorBoxes({ label, value, change, paste }: VectorBoxesProps) {
  const [parts, setParts] = useState(() => partsOf(value));
  useLayoutEffect(() => {
    if (value !== joined(parts)) setParts(partsOf(value));
  }, [value]);
  const put = (next: string[]) => {
    setParts(next);
    change(joined(next));
  };
  const type = (i: number, typed: string) => {
    const several = typed.split(/[\s;]+/).filter(Boolean);
    put(several.length === AXES.length ? several : parts.with(i, typed));
  };
  return (
    <span class="vector">
      {AXES.map((axis, i) => (
        <input
          type="text"
          inputMode="decimal"
          autocomplete="off"
          aria-label={`${label} ${axis}`}
          value={parts[i]}
          onPaste={paste}
          onInput={(event) => type(i, event.currentTarget.value)}
        />
      ))}
    </span>
  );
}

/** The names of the axes above the boxes of several vectors. */
export const VectorAxes = () => (
  <small class="vector soft" aria-hidden="true">
    {AXES.map((axis) => (
      <span>{axis}</span>
    ))}
  </small>
);
