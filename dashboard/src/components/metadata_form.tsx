/** A form for what people note about a measurement set. */
import { METADATA, type Metadata } from "../api/types";
import type { Typed } from "../lib/metadata";
import { text } from "../i18n";
import { TextField } from "./fields";

const LONGEST: Record<Exclude<keyof Metadata, "measured_at">, number> = {
  serial_number: 200,
  item_condition: 200,
  operator: 200,
  instrument: 200,
  conditions: 200,
  notes: 2000,
};

export function MetadataForm({ typed, change }: { typed: Typed; change: (typed: Typed) => void }) {
  const words = text.metadata;
  return (
    <>
      {METADATA.map((name) => {
        return (
          <TextField
            label={words.fields[name]}
            help={name === "measured_at" ? words.zone : undefined}
            type={name === "measured_at" ? "datetime-local" : "text"}
            placeholder={words.placeholders[name] ?? ""}
            value={typed[name]}
            change={(value) => change({ ...typed, [name]: value })}
            {...(name === "measured_at" ? {} : { maxLength: LONGEST[name] })}
            {...(name === "notes" ? { lines: 4 } : {})}
          />
        );
      })}
    </>
  );
}
