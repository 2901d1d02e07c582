/** What the integrity checks say of readings. */
import type { Facts as FileFacts } from "../lib/campaign";
import { fixed, significant } from "../lib/format";
import { text } from "../i18n";
import { type Fact, Facts, Name, Warnings } from "./basics";
import type { Finding } from "../api/types";

export function Findings({ warnings }: { warnings: Finding[] }) {
  if (warnings.length === 0) return <p class="note good">{text.files.clean}</p>;
  return (
    <>
      <h3>{text.files.findings(warnings.length)}</h3>
      <Warnings warnings={warnings} />
    </>
  );
}

/** Warnings that no reason says, folded away: the verdict does not rest on them. */
export function Further({ warnings }: { warnings: Finding[] }) {
  if (warnings.length === 0) return null;
  return (
    <details class="card further">
      <summary>{text.assessment.more(warnings.length)}</summary>
      <Warnings warnings={warnings} />
    </details>
  );
}

/** Targets by name, as many as have room. */
const TARGETS = 6;

/** What was understood of a file: units first, as they cannot be found out later. */
export function Preview({ facts }: { facts: FileFacts }) {
  const { notSaid, facts: labels, ...words } = text.files;
  const { units, encoders, targets, forces, sigma, noise, loadPoint } = facts;
  const [low, high] = forces?.map((force) => fixed(force, 0)) ?? [];
  const shown: Fact[] = [
    { label: labels.units, value: units ? [units.length, units.angle, units.force].join(", ") : notSaid },
    { label: labels.encoders, value: encoders ? words.encoders[encoders] : notSaid },
    { label: labels.observations, value: String(facts.observations) },
    {
      label: labels.targets,
      value: targets.length > 0 && (
        <>
          {targets.length}: {targets.slice(0, TARGETS).map((target, i) => [i > 0 && ", ", <Name>{target}</Name>])}
          {targets.length > TARGETS && " …"}
        </>
      ),
    },
    { label: labels.load, value: forces && `${low === high ? "" : `${low} – `}${high} ${text.units.newton}` },
    {
      label: labels.noise,
      value:
        sigma !== null
          ? `${significant(sigma * 1e6, 2)} ${text.units.micrometre}`
          : noise
            ? words.noiseKinds[noise]
            : words.noiseAbsent,
    },
    {
      label: labels.loadPoint,
      value: loadPoint
        ? `(${loadPoint.map((part) => fixed(part * 1e3, 0)).join(", ")}) ${text.units.mm}`
        : words.loadPointPer,
    },
    ...(facts.framed ? [{ label: labels.frame, value: words.trackerFrame }] : []),
  ];
  return <Facts facts={shown.map(({ label, value }) => ({ label, value: value || notSaid }))} />;
}
