/** Why the numbers can be trusted: what the joints are seen by, the certificate, what the service says, provenance. */
import type { RunResult } from "../api/types";
import { Facts, Name, NameLink, When, Term } from "../components/basics";
import { JobLines } from "../components/job_tables";
import { significant } from "../lib/format";
import { text } from "../i18n";
import { useState } from "preact/hooks";
import { type RunContext, isElastic } from "./run_context";

const words = text.evidence;
const small = (value: number): string => (value === 0 ? "0" : significant(value, 2));

export function Evidence({ context: { run, set }, result }: { context: RunContext; result: RunResult }) {
  const [open, setOpen] = useState(false);
  const elastic = isElastic(run); // what is said of identifiability is then of the joints alone
  const { identifiability: found, certificate } = result;
  const { provenance } = run;
  return (
    <details class="card evidence" onToggle={(event) => setOpen(event.currentTarget.open)}>
      <summary>
        <h2>{words.title}</h2>
      </summary>
      {elastic && <p class="soft">{words.jointsAlone}</p>}
      <Facts
        facts={[
          { label: <Term of="rank">{words.rank}</Term>, value: words.rankOf(found.rank, found.parameters) },
          {
            label: <Term of="condition">{words.condition}</Term>,
            value: found.condition_number === null ? words.conditionNone : significant(found.condition_number, 3),
          },
          ...found.combinations.map((group) => ({
            label: words.combinations,
            value: <Name>{group.join(" + ")}</Name>,
          })),
          {
            label: <Term of="certificate">{words.certificate}</Term>,
            value: [certificate.primal, certificate.dual, certificate.complementarity].map(small).join(", "),
          },
          { label: words.solvedBy, value: certificate.solved_by.map((solver) => words.solvers[solver]).join(", ") },
        ]}
      />
      {open && <JobLines collection="runs" id={run.id} of="evidence" />}
      <h3>{words.provenance}</h3>
      <Facts
        wide
        facts={[
          { label: text.sets.kind, value: <NameLink to={["sets", set.id]}>{set.name}</NameLink> },
          { label: words.created, value: <When time={provenance.created_at} /> },
          { label: words.identifier, value: <code>{run.id}</code> },
          { label: words.input, value: <code>{provenance.input_hash}</code> },
          {
            label: words.versions,
            value: Object.entries(provenance.versions)
              .map((version) => version.join(" "))
              .join(", "),
          },
        ]}
      />
      <details>
        <summary>{words.request}</summary>
        <pre tabIndex={0}>{JSON.stringify(run.request, null, 2)}</pre>
      </details>
    </details>
  );
}
