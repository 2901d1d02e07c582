/** A form for what people note about a measurement set. */
import { METADATA } from "../api/types";
import type { Typed } from "../lib/metadata";
import { later } from "../i18n/later";
import { TextField } from "./fields";

const words = later.metadata;

export const MetadataForm = ({ typed, change }: { typed: Typed; change: (typed: Typed) => void }) => (
  <>
    {METADATA.map((name) => (
      <TextField
        key={name}
        label={words.fields[name]}
        placeholder={words.placeholders[name] ?? ""}
        value={typed[name]}
        change={(next) => change({ ...typed, [name]: next })}
        {...(name === "measured_at" ? { help: words.zone, type: "datetime-local" } : {})}
        {...(name === "notes" ? { lines: 4, maxLength: 2000 } : { maxLength: 200 })}
      />
    ))}
  </>
);
