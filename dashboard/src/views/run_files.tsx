/** Files of a run to take along: a report to sign, and the model in the formats of other programs. */
import { api } from "../api/client";
import { text } from "../i18n";

const words = text.runFiles;

export function RunFiles({ run }: { run: string }) {
  return (
    <section class="card">
      <h2>{words.title}</h2>
      <p class="soft">{words.note}</p>
      <div class="actions">
        <a class="button" href={api.runReport(run, "pdf")} download>
          {words.pdf}
        </a>
        <a class="button" href={api.runReport(run, "html")} target="_blank" rel="noreferrer">
          {words.html}
        </a>
        {(Object.keys(words.models) as (keyof typeof words.models)[]).map((format) => (
          <a class="button" key={format} href={api.runModel(run, format)} title={words.models[format][1]} download>
            {words.models[format][0]}
          </a>
        ))}
      </div>
    </section>
  );
}
