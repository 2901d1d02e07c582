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

/** What was understood of a file: units first, as they cannot be found out later. */
export function Preview({ facts }: { facts: FileFacts }) {
  const words = text.files.facts;
  const shown: Fact[] = [
    { label: words.units, value: units(facts) },
    { label: words.encoders, value: encoders(facts) },
    { label: words.observations, value: String(facts.observations) },
    { label: words.targets, value: targets(facts) },
    { label: words.load, value: load(facts) },
    { label: words.noise, value: noise(facts) },
    { label: words.loadPoint, value: loadPoint(facts) },
    ...(facts.framed ? [{ label: words.frame, value: text.files.trackerFrame }] : []),
  ];
  return <Facts facts={shown} />;
}

function noise({ sigma, noise: kind }: FileFacts): string {
  if (sigma !== null) return `${significant(sigma * 1e6, 2)} ${text.units.micrometre}`;
  return kind === null ? text.files.noiseAbsent : text.files.noiseKinds[kind];
}

function units({ units: given }: FileFacts): string {
  return given ? [given.length, given.angle, given.force].join(", ") : text.files.notSaid;
}

function encoders({ encoders: given }: FileFacts): string {
  return given === null ? text.files.notSaid : text.files.encoders[given];
}

function targets({ targets: given }: FileFacts) {
  if (given.length === 0) return text.files.notSaid;
  return (
    <>
      {given.length}:{" "}
      {given.slice(0, 6).map((target, i) => (
        <>
          {i > 0 && ", "}
          <Name>{target}</Name>
        </>
      ))}
      {given.length > 6 && " …"}
    </>
  );
}

function load({ forces }: FileFacts): string {
  if (!forces) return text.files.notSaid;
  const [low, high] = forces;
  const same = high - low <= 0.005 * high;
  return `${same ? "" : `${fixed(low, 0)} – `}${fixed(high, 0)} ${text.units.newton}`;
}

function loadPoint({ loadPoint: given }: FileFacts): string {
  if (!given) return text.files.loadPointPer;
  return `(${given.map((v) => fixed(v * 1e3, 0)).join(", ")}) ${text.units.mm}`;
}
