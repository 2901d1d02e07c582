/** Files of a run to take along: a report to sign, and the model in the formats of other programs. */
import { useState } from "preact/hooks";
import { api } from "../api/client";
import type { Assessment } from "../api/types";
import { Name, ProblemNote, When } from "../components/basics";
import { useAction } from "../state/action";
import { useLoad, valueOf } from "../state/load";
import { text } from "../i18n";

const words = text.runFiles;

export function RunFiles({ run, assessment }: { run: string; assessment: Assessment }) {
  const refused = assessment.verdict === "do_not_use";
  const sure = (event: Event) => {
    if (refused && !confirm(text.assessment.sure(assessment.reasons.map(({ message }) => message))))
      event.preventDefault();
  };
  return (
    <section class="card">
      <h2>{words.title}</h2>
      <p class="soft">{words.note}</p>
      <div class="actions">
        <a class="button" href={api.runs.file(run, "report.pdf")} download>
          {words.pdf}
        </a>
        <a class="button" href={api.runs.file(run, "report.html")} target="_blank" rel="noreferrer">
          {words.html}
        </a>
        {(Object.keys(words.models) as (keyof typeof words.models)[]).map((format) => (
          <a
            class="button"
            key={format}
            href={api.runs.file(run, `model.${format}${refused ? "?accept_verdict=do_not_use" : ""}`)}
            onClick={sure}
            title={words.models[format][1]}
            download
          >
            {words.models[format][0]}
          </a>
        ))}
      </div>
      <Authorisations run={run} />
    </section>
  );
}

/** Who authorised the report; admins may. */
function Authorisations({ run }: { run: string }) {
  const loaded = useLoad(
    async (signal) => {
      const [found, session] = await Promise.all([api.authorisations(run, signal), api.session()]);
      return { items: found.items, may: session.role === "admin" };
    },
    [run],
  );
  const [note, setNote] = useState("");
  const authorise = useAction(async () => {
    await api.authorise(run, note.trim());
    setNote("");
    loaded.reload();
  });
  const found = valueOf(loaded);
  if (!found) return loaded.state === "failed" ? <ProblemNote problem={loaded.problem} /> : null;
  return (
    <>
      {found.items.map((each) => (
        <p key={each.authorised_at}>
          {words.authorisedBy} <Name>{each.key_name}</Name>, <When time={each.authorised_at} />
          {each.note && (
            <>
              : <Name>{each.note}</Name>
            </>
          )}
        </p>
      ))}
      {found.items.length === 0 && <p class="soft">{words.draft}</p>}
      {!found.may && <p class="soft">{words.howToAuthorise}</p>}
      {found.may && (
        <div class="row">
          <label class="field">
            <span>{words.remark}</span>
            <input type="text" maxLength={200} value={note} onInput={(event) => setNote(event.currentTarget.value)} />
          </label>
          <button type="button" class="button" disabled={authorise.busy} onClick={authorise.run}>
            {words.authorise}
          </button>
        </div>
      )}
      {authorise.problem && <ProblemNote problem={authorise.problem} />}
    </>
  );
}
