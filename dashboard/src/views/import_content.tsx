/** The files as they were understood, and the templates that fit them. */
import type { ImportAnswer, ImportOptions } from "../api/types";
import { Button, Choice } from "../components/basics";
import { SchemaFields, type Terms } from "../components/schema_form";
import { type ImportFault, meaningsFor, widthOf } from "../lib/columns";
import type { Fields } from "../lib/json";
import { later } from "../i18n/later";
import { useMemo, useRef } from "preact/hooks";
import { type Template, fits } from "../lib/template";
import { keptTemplates } from "../state/opened";
import { FaultList, ImportTable } from "./import_table";

const words = later.imports;

export function ImportContent({
  answer,
  files,
  options,
  change,
  use,
}: {
  answer: ImportAnswer;
  files: File[];
  options: ImportOptions;
  change: (options: ImportOptions) => void;
  use: (template: Template) => void;
}) {
  const { preview, faults } = answer;
  const groups = useMemo(() => meaningsFor(preview.files, preview.targets), [answer]);
  const named = new Set(preview.files.map(({ file }) => file));
  const offered = useMemo(() => keptTemplates().find((one) => fits(one, preview)), [answer]);
  const inUse = (options.layouts ?? []).length > 0;
  return (
    <>
      {offered && !inUse && (
        <div class="note good row">
          <p>{words.fits(offered.name)}</p>
          <Button onClick={() => use(offered)}>{words.useTemplate}</Button>
        </div>
      )}
      {inUse && (
        <div class="row by-template">
          <span class="soft">{words.byTemplate}</span>
          <Button look="quiet" onClick={() => change({})}>
            {words.withoutTemplate}
          </Button>
        </div>
      )}
      <FaultList faults={faults.filter(({ file }) => file === null || !named.has(file))} />
      <ImportReading files={files} faults={faults} options={options} change={change} />
      {preview.files.map((one) => (
        <ImportTable
          key={one.file}
          preview={one}
          file={files.find(({ name }) => name === one.file)}
          faults={faults.filter(({ file }) => file === one.file)}
          options={options}
          change={change}
          groups={groups}
        />
      ))}
      {preview.assumptions.length > 0 && (
        <ul class="assumptions">
          {preview.assumptions.map((assumption) => (
            <li>{assumption}</li>
          ))}
        </ul>
      )}
    </>
  );
}

const readingWords = later.imports.reading;
type Change = (options: ImportOptions) => void;

/** How files are read where that is not plain: controls for the options that faults name, and for those that are set. */
function ImportReading({
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
  const offered = faults.find((fault) => fault.option === "sheet")?.words;
  const known = useRef<string[]>([]); // once one is chosen, no fault names them
  if (offered && offered.length > 0) known.current = offered;
  const sheets = known.current.length > 0 ? known.current : options.sheet ? [options.sheet] : [];
  const pair = asked ?? (stated.length === 2 ? stated : null);
  const terms: Terms = {
    labels: readingWords.texts,
    choices: {
      sheet: ["", ...sheets].map((name) => ({ value: name, label: name || readingWords.pickSheet })),
    },
  };
  return (
    <div class="import-form">
      {headless && /\.xlsx$/i.test(headless.name) === false && (
        <Button onClick={() => void headless.text().then((content) => put({ header: unnamed(content) }))}>
          {readingWords.nameColumns}
        </Button>
      )}
      {pair && (
        <Choice
          label={readingWords.unloadedWord}
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
      <SchemaFields
        of="ImportRequest"
        show={READING.filter(shown)}
        value={options as Fields}
        change={change}
        terms={terms}
      />
    </div>
  );
}

/** Options of how files are read that are asked for where a fault names them. */
const READING = ["decimal_mark", "delimiter", "allow_missing", "by_order", "sheet", "point_name", "file_name"] as const;

/** A header by which no column is used yet: the table is shown, and each is given its meaning there. */
const unnamed = (content: string): string[] => Array.from({ length: widthOf(content) }, () => "ignore");
