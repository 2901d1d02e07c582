/** A form for what people note about a measurement set. */
import { METADATA, type Metadata } from "../api/types";
import type { Typed } from "../lib/metadata";
import { text } from "../i18n";
import { type FieldOf, FormFields } from "./form";

const LONGEST: Record<Exclude<keyof Metadata, "measured_at">, number> = {
  serial_number: 200,
  item_condition: 200,
  operator: 200,
  instrument: 200,
  conditions: 200,
  notes: 2000,
};

const words = text.metadata;
const FIELDS = METADATA.map(
  (name): FieldOf<Typed> => ({
    name,
    label: words.fields[name],
    placeholder: words.placeholders[name] ?? "",
    ...(name === "measured_at" ? { help: words.zone, type: "datetime-local" } : { maxLength: LONGEST[name] }),
    ...(name === "notes" ? { lines: 4 } : {}),
  }),
);

export const MetadataForm = ({ typed, change }: { typed: Typed; change: (typed: Typed) => void }) => (
  <FormFields fields={FIELDS} values={typed} change={(part) => change({ ...typed, ...part })} />
);
