/** What the integrity checks say of readings. */
import { type Facts as FileFacts, factorOf } from "../lib/campaign";
import { fixed, significant } from "../lib/format";
import { UNITS } from "../lib/stiffness";
import { text } from "../words";
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
  const faults = (Object.keys(UNITS) as (keyof typeof UNITS)[]).filter(
    (of) => (units?.[of] || of !== "moment") && !factorOf(units, of),
  );
  const [length, force] = (["length", "force"] as const).map((of) => (faults.includes(of) ? units?.[of] : null));
  const fault = (of: keyof typeof UNITS) => (
    <span class="fault">{words.noUnit(of, units?.[of] ?? "", Object.keys(UNITS[of]))}</span>
  );
  const [low, high] = forces?.map((size) => (force ? significant(size, 4) : fixed(size, 0))) ?? [];
  const shown: Fact[] = [
    {
      label: labels.units,
      value: units && [Object.values(units).filter(Boolean).join(", ") || notSaid, ...faults.map(fault)],
    },
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
    { label: labels.load, value: forces && `${low === high ? "" : `${low} – `}${high} ${force ?? text.units.newton}` },
    {
      label: labels.noise,
      value:
        sigma !== null
          ? `${significant(length ? sigma : sigma * 1e6, 2)} ${length ?? text.units.micrometre}`
          : noise
            ? words.noiseKinds[noise]
            : words.noiseAbsent,
    },
    {
      label: labels.loadPoint,
      value: loadPoint
        ? `(${loadPoint.map((part) => (length ? significant(part, 4) : fixed(part * 1e3, 0))).join(", ")}) ${length ?? text.units.mm}`
        : words.loadPointPer,
    },
    ...(facts.framed ? [{ label: labels.frame, value: words.trackerFrame }] : []),
  ];
  return <Facts facts={shown.map(({ label, value }) => ({ label, value: value || notSaid }))} />;
}
