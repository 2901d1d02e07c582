/** What a program is corrected for: its files, tool, base, process force, and the controller's accuracy option. */
import { useState } from "preact/hooks";
import { api } from "../api/client";
import { ActionButton, Button } from "../components/basics";
import { DropZone } from "../components/drop";
import { TextField, Select } from "../components/fields";
import { freshKey } from "../lib/hash";
import { numbersIn } from "../lib/program";
import { asking, useAction } from "../state/action";
import { go, link } from "../state/router";
import { text } from "../i18n";
import type { RunContext } from "./run_context";

const words = text.program;
const ACCURACY = ["", "off", "same_as_measured", "compensates_load"] as const;

export function ProgramForm({ context: { run } }: { context: RunContext }) {
  const [files, setFiles] = useState<File[]>([]);
  const [accuracy, setAccuracy] = useState("");
  const [force, setForce] = useState("0 0 -500");
  const [axes, setAxes] = useState("robot");
  const [tool, setTool] = useState("");
  const [base, setBase] = useState("");
  const [start, setStart] = useState("");
  const make = useAction(async () => {
    const frame = (value: string) => (value.trim() ? [{ values: numbersIn(value) ?? [] }] : []);
    const stated = {
      run_id: run.id,
      units: { length: "mm", angle: "deg", force: "N" },
      accuracy_option: accuracy,
      load: { force: numbersIn(force) ?? [] },
      axes,
      tools: frame(tool),
      bases: frame(base),
      ...(start.trim() ? { start: numbersIn(start) ?? [] } : {}),
    };
    const made = await asking((accepted) => api.addProgram(files, { ...stated, ...accepted }, freshKey("program")));
    go(link(["programs", made.id]));
  });
  const take = (file: File) => setFiles((before) => [...before.filter((one) => one.name !== file.name), file]);
  return (
    <section class="card form">
      <h2>{words.form}</h2>
      <p>{words.formNote}</p>
      <DropZone title={words.drop} hint={words.dropHint} button={words.choose} accept={words.accept} take={take} />
      {files.length > 0 && (
        <ul>
          {files.map((file) => (
            <li>
              <bdi>{file.name}</bdi>{" "}
              <Button look="quiet" onClick={() => setFiles(files.filter((one) => one.name !== file.name))}>
                {words.remove}
              </Button>
            </li>
          ))}
        </ul>
      )}
      <Select
        label={words.accuracy}
        value={accuracy}
        change={setAccuracy}
        options={ACCURACY.map((value) => ({ value, label: words.accuracies[value || "none"] }))}
      />
      <div class="map-fields">
        <Numbers label={`${words.force} [${text.units.newton}]`} value={force} change={setForce} />
        <Select
          label={words.axes}
          value={axes}
          change={setAxes}
          options={(["robot", "tool", "base"] as const).map((value) => ({ value, label: words.axesOf[value] }))}
        />
        <Numbers label={words.tool} value={tool} change={setTool} help={words.frameHint} />
        <Numbers label={words.base} value={base} change={setBase} help={words.frameHint} />
        <Numbers label={`${words.start} [${text.units.deg}]`} value={start} change={setStart} help={words.startHint} />
      </div>
      <ActionButton look="primary" action={make} disabled={files.length === 0 || accuracy === ""}>
        {words.make}
      </ActionButton>
    </section>
  );
}

const Numbers = ({ value, ...rest }: Parameters<typeof TextField>[0]) => (
  <TextField {...rest} value={value} aria-invalid={numbersIn(value) === null} />
);
