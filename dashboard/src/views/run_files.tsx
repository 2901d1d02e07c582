/** Files of a run to take along: a report to sign, and the model in the formats of other programs. */
import { useState } from "preact/hooks";
import { api } from "../api/client";
import type { Assessment } from "../api/types";
import { ActionButton, Download, Button, LinkButton, Name, ProblemNote, When } from "../components/basics";
import { TextField } from "../components/fields";
import { useAction } from "../state/action";
import { useLoad, valueOf } from "../state/load";
import { text } from "../i18n";
import { later } from "../i18n/later";

const words = later.runFiles;

export function RunFiles({ run, assessment }: { run: string; assessment: Assessment }) {
  const refused = assessment.verdict === "do_not_use";
  const sure = (event: Event) => {
    if (refused && !confirm(text.assessment.sure(assessment.reasons.map(({ message }) => message))))
      event.preventDefault();
  };
  return (
    <section class="card">
      <h2>{words.title}</h2>
      <p class="soft">{words.intro}</p>
      <div class="actions">
        <Download href={api.jobs.file(run, "report.pdf")}>{words.pdf}</Download>
        <LinkButton href={api.jobs.file(run, "report.html")} target="_blank" rel="noreferrer">
          {words.html}
        </LinkButton>
        {(Object.keys(words.models) as (keyof typeof words.models)[]).map((format) => (
          <LinkButton
            key={format}
            href={api.jobs.file(run, `model.${format}${refused ? "?accept_verdict=do_not_use" : ""}`)}
            onClick={sure}
            title={words.models[format][1]}
            download
          >
            {words.models[format][0]}
          </LinkButton>
        ))}
      </div>
      <Authorisations run={run} />
    </section>
  );
}

const BLANK = { note: "", customer: "", received: "" };

/** Who authorised the report; admins may. */
function Authorisations({ run }: { run: string }) {
  const loaded = useLoad(
    async (signal) => {
      const [found, session] = await Promise.all([api.authorisations(run, signal), api.session()]);
      return { items: found.items, may: session.role === "admin", name: session.key_name };
    },
    [run],
  );
  /** What is stated in the report; null while nobody authorises. */
  const [asked, setAsked] = useState<typeof BLANK | null>(null);
  const authorise = useAction(async () => {
    const { note = "", customer = "", received = "" } = asked ?? {};
    await api.authorise(run, {
      note: note.trim() || null,
      customer: customer.trim() ? { name: customer.trim() } : null,
      received_on: received || null,
    });
    setAsked(null);
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
          {" · "}
          <a href={api.jobs.file(run, `issued-${each.number}.pdf`)} title={`SHA-256 ${each.pdf_sha256}`} download>
            {words.issued(each.number)}
          </a>
        </p>
      ))}
      {found.items.length === 0 && <p class="soft">{words.draft}</p>}
      {!found.may && <p class="soft">{words.howToAuthorise}</p>}
      {found.may && !asked && <Button onClick={() => setAsked(BLANK)}>{words.authorise}</Button>}
      {asked && (
        <div class="note warn" role="group" aria-label={words.sure}>
          <div class="row">
            {(["note", "customer", "received"] as const).map((name) => (
              <TextField
                key={name}
                label={words[name]}
                type={name === "received" ? "date" : "text"}
                value={asked[name]}
                maxLength={200}
                change={(typed) => setAsked({ ...asked, [name]: typed })}
              />
            ))}
          </div>
          <p>{words.states(found.name ?? "")}</p>
          <div class="actions">
            <LinkButton href={`${api.jobs.file(run, "report.html")}?draft=true`} target="_blank" rel="noreferrer">
              {words.draftNow}
            </LinkButton>
            <ActionButton look="primary" action={authorise}>
              {words.sure}
            </ActionButton>
            <Button look="quiet" onClick={() => setAsked(null)}>
              {words.cancel}
            </Button>
          </div>
        </div>
      )}
    </>
  );
}
