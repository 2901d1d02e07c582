/** How files are read where that is not plain: controls for the options that faults name, and for those that are set. */
import type { ImportOptions } from "../api/types";
import { Button, Choice, Toggle } from "../components/basics";
import { Field, Select } from "../components/fields";
import type { ImportFault } from "../lib/columns";
import { widthOf } from "../lib/lines";
import { entriesOf } from "../lib/entries";
import { text } from "../i18n";

const words = text.imports.reading;
type Change = (options: ImportOptions) => void;

export function ImportReading({
  files,
  faults,
  options,
  change,
}: {
  files: File[];
  faults: ImportFault[];
  options: ImportOptions;
  change: Change;
}) {
  const named = new Set(faults.map((fault) => fault.option));
  const shown = (option: keyof ImportOptions & string) => named.has(option) || Boolean(options[option]);
  const put = (part: Partial<ImportOptions>) => change({ ...options, ...part });
  const headless = files.find((file) => faults.some((fault) => fault.option === "header" && fault.file === file.name));
  const stated = Object.keys(options.state_words ?? {});
  const asked = faults.find((fault) => fault.option === "state_words" && fault.words.length === 2)?.words;
  const pair = asked ?? (stated.length === 2 ? stated : null);
  return (
    <div class="import-form">
      {headless && /\.xlsx$/i.test(headless.name) === false && (
        <Button onClick={() => void headless.text().then((content) => put({ header: unnamed(content) }))}>
          {words.nameColumns}
        </Button>
      )}
      {shown("decimal_mark") && (
        <Choice
          label={words.decimalMark}
          value={options.decimal_mark ?? ""}
          change={(mark) => put({ decimal_mark: mark === "" ? null : mark })}
          options={entriesOf(words.marks).map(([value, label]) => ({ value, label }))}
        />
      )}
      {shown("delimiter") && (
        <Select
          label={words.delimiter}
          value={options.delimiter ?? ""}
          change={(delimiter) => put({ delimiter: (delimiter || null) as NonNullable<ImportOptions["delimiter"]> })}
          options={entriesOf(words.delimiters).map(([value, label]) => ({ value, label }))}
        />
      )}
      {pair && (
        <Choice
          label={words.unloadedWord}
          value={pair.find((word) => options.state_words?.[word] === "unloaded") ?? ""}
          change={(unloaded) =>
            put({
              state_words: {
                ...options.state_words,
                ...Object.fromEntries(pair.map((word) => [word, word === unloaded ? "unloaded" : "loaded"] as const)),
              },
            })
          }
          options={pair.map((word) => ({ value: word, label: word }))}
        />
      )}
      {shown("allow_missing") && (
        <Toggle
          label={words.allowMissing}
          checked={options.allow_missing ?? false}
          change={(allow_missing) => put({ allow_missing })}
        />
      )}
      {shown("by_order") && (
        <Toggle label={words.byOrder} checked={options.by_order ?? false} change={(by_order) => put({ by_order })} />
      )}
      {(["sheet", "point_name", "file_name"] as const).filter(shown).map((option) => (
        <Field label={words.texts[option]} help={words.textsHelp[option]}>
          {(control) => (
            <input
              type="text"
              autocomplete="off"
              {...control}
              value={options[option] ?? ""}
              onInput={(event) => put({ [option]: event.currentTarget.value || null })}
            />
          )}
        </Field>
      ))}
    </div>
  );
}

/** A header by which no column is used yet: the table is shown, and each is given its meaning there. */
const unnamed = (content: string): string[] => Array.from({ length: widthOf(content) }, () => "ignore");
