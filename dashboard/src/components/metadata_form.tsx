/** A form for what people note about a measurement set. */
import { METADATA, type Metadata } from "../api/types";
import type { Typed } from "../lib/metadata";
import { text } from "../i18n";
import { Field } from "./fields";

const LONGEST: Record<Exclude<keyof Metadata, "measured_at">, number> = {
  serial_number: 200,
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
        const put = (value: string) => change({ ...typed, [name]: value });
        return (
          <Field label={words.fields[name]} help={name === "measured_at" ? words.zone : undefined}>
            {(control) =>
              name === "measured_at" ? (
                <input
                  {...control}
                  type="datetime-local"
                  value={typed[name]}
                  onInput={(event) => put(event.currentTarget.value)}
                />
              ) : name === "notes" ? (
                <textarea
                  {...control}
                  rows={4}
                  maxLength={LONGEST[name]}
                  value={typed[name]}
                  onInput={(event) => put(event.currentTarget.value)}
                />
              ) : (
                <input
                  {...control}
                  type="text"
                  maxLength={LONGEST[name]}
                  placeholder={words.placeholders[name] ?? ""}
                  value={typed[name]}
                  onInput={(event) => put(event.currentTarget.value)}
                />
              )
            }
          </Field>
        );
      })}
    </>
  );
}
