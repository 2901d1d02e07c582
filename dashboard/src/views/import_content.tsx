/** The files as they were understood, and the templates that fit them. */
import { useMemo } from "preact/hooks";
import type { ImportAnswer, ImportOptions } from "../api/types";
import { meaningsFor } from "../lib/columns";
import { fits, type Template } from "../lib/template";
import { keptTemplates } from "../state/templates";
import { text } from "../i18n";
import { ImportReading } from "./import_reading";
import { FaultList, ImportTable } from "./import_table";
import { Button } from "../components/basics";

const words = text.imports;

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
