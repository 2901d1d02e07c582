/** Two sets side by side: stiffness ratios with intervals, and the deflection that the second avoids. */
import { api } from "../api/client";
import type { Pair } from "../api/types";
import { Bars } from "../charts/bars";
import { Figure } from "../charts/figure";
import { StiffnessIntervals, Intervals, markOf } from "../charts/intervals";
import { NameLink, LinkButton, Name } from "../components/basics";
import { JobPage } from "../components/job_page";
import { JobTables } from "../components/job_tables";
import { alike } from "../components/table";
import { pValue, percent, significant } from "../lib/format";
import { unsaid } from "../lib/said";
import { STIFFNESS_UNITS, intervalIn, maybeInUnit } from "../lib/units";
import { storedSet } from "../state/stored";
import { link } from "../state/router";
import { useSettings } from "../state/settings";
import { text } from "../i18n";
import { Further } from "../components/findings";
import { VerdictCard } from "./verdict_card";

const words = text.pair;
type Result = NonNullable<Pair["result"]>;

const sideOf = (side: Pair["request"]["first"]): string =>
  side.run_id ? `run:${side.run_id}` : `set:${side.measurement_set_id ?? ""}`;

export function PairView({ id }: { id: string }) {
  return (
    <JobPage
      collection="pairs"
      id={id}
      kind={words.kind}
      load={async (signal) => {
        const pair = await api.pairs.one(id, signal);
        const [first, second] = await Promise.all([storedSet(pair.first_set_id), storedSet(pair.second_set_id)]);
        const same = first.name === second.name;
        const named = (name: string, side: string) => (same ? `${name} (${side})` : name);
        return { job: pair, sides: [named(first.name, words.first), named(second.name, words.second)] as const };
      }}
      head={({ job, sides: [first, second] }) => ({
        name: words.title(first, second),
        title: (
          <>
            <Name>{first}</Name> → <Name>{second}</Name>
          </>
        ),
        list: "#/compare/pairs",
        about: (
          <>
            <NameLink to={["sets", job.first_set_id]}>{first}</NameLink>
            <NameLink to={["sets", job.second_set_id]}>{second}</NameLink>
          </>
        ),
        actions: (
          <LinkButton
            href={link(["compare", "pairs"], { first: sideOf(job.request.second), second: sideOf(job.request.first) })}
          >
            {words.swap}
          </LinkButton>
        ),
      })}
    >
      {(result, { job, sides }) => (
        <PairPage
          id={job.id}
          result={result}
          sides={sides}
          level={percent(job.request.confidence ?? job.request.options?.confidence ?? 0.95)}
        />
      )}
    </JobPage>
  );
}

/** Names of the first and the second side. */
type Sides = readonly [string, string];

function PairPage({ id, result, sides, level }: { id: string; result: Result; sides: Sides; level: string }) {
  return (
    <>
      <VerdictCard assessment={result.assessment} context={null} />
      <Further warnings={unsaid(result.warnings, result.assessment.reasons)} />
      <Avoided result={result} />
      <Ratios result={result} sides={sides} level={level} />
      <Both result={result} sides={sides} level={level} />
      <ByConfiguration result={result} />
      <JobTables collection="pairs" id={id} from={1} />
    </>
  );
}

function Avoided({ result: { avoided } }: { result: Result }) {
  const share = (value: number | null | undefined) => (value === null || value === undefined ? "–" : percent(value));
  return (
    <ul class="summary">
      <li>
        <b>{share(avoided.measured?.value)}</b>
        {words.avoided}, {words.measured}
        {avoided.matching === 0 && `: ${words.noMatch}`}
      </li>
      <li>
        <b>{share(avoided.predicted)}</b>
        {words.avoided}, {words.predicted}
      </li>
      <li>
        <b>{avoided.matching}</b>
        {words.matching(avoided.matching)}
      </li>
    </ul>
  );
}

function Ratios({ result, sides, level }: { result: Result; sides: Sides; level: string }) {
  const title = words.ratioOf(...sides);
  const show = (v: number) => significant(v, 3);
  return (
    <Figure
      title={title}
      note={words.ratioNote(level)}
      table={{
        columns: [
          text.run.joint,
          { title, show },
          ...alike([text.run.low, text.run.high], undefined, show),
          { title: text.evidence.pValue, show: pValue },
          text.run.verdict,
        ],
        rows: result.joints.map((joint) => [
          joint.name,
          joint.ratio,
          joint.ratio_interval?.[0],
          joint.ratio_interval?.[1],
          joint.p_value,
          verdict(joint.p_value, joint.reason),
        ]),
      }}
    >
      {(width) => (
        <Intervals
          rows={result.joints.map((joint) => ({
            name: joint.name,
            marks: [
              {
                mark: changed(joint.p_value) ? "positive" : "free",
                value: joint.ratio,
                low: joint.ratio_interval?.[0] ?? null,
                high: joint.ratio_interval ? joint.ratio_interval[1] : joint.ratio,
                instead: joint.reason === null ? "–" : text.verdicts.unobservable,
                label: `${joint.name}: ${joint.ratio === null ? "–" : show(joint.ratio)}`,
              },
            ],
          }))}
          width={width}
          label={title}
          unit={words.ratioAxis}
          format={(v) => String(Number(v.toPrecision(2)))}
          reference={1}
        />
      )}
    </Figure>
  );
}

const changed = (p: number | null): boolean => p !== null && p < 0.05;
const verdict = (p: number | null, reason: string | null): string =>
  p === null ? (reason ?? "–") : changed(p) ? words.changed : words.unchanged;

function Both({ result, sides, level }: { result: Result; sides: Sides; level: string }) {
  const { unit } = useSettings();
  const { column } = STIFFNESS_UNITS[unit];
  const u = { unit: column };
  return (
    <Figure
      title={words.stiffness}
      note={text.run.stiffnessNote(level)}
      legend={[
        { label: sides[0], mark: "method-1" },
        { label: sides[1], mark: "method-0" },
      ]}
      table={{
        columns: [
          text.run.joint,
          ...sides.flatMap((side) => [
            { title: side, ...u },
            { title: `${side} ${text.run.low}`, ...u },
            { title: `${side} ${text.run.high}`, ...u },
          ]),
        ],
        rows: result.joints.map((joint) => [
          joint.name,
          ...[joint.first, joint.second].flatMap((side) => [
            maybeInUnit(side.stiffness, unit),
            ...intervalIn(side.stiffness_interval, unit),
          ]),
        ]),
      }}
    >
      {(width) => (
        <StiffnessIntervals
          rows={result.joints.map((joint) => ({
            name: joint.name,
            marks: [markOf(joint.first, "method-1", unit), markOf(joint.second, "method-0", unit)],
          }))}
          {...{ width, unit }}
          label={words.stiffness}
        />
      )}
    </Figure>
  );
}

function ByConfiguration({ result: { avoided } }: { result: Result }) {
  const names = avoided.configurations.map((one) => one.observation);
  const series = [
    {
      mark: "measured",
      label: words.measured,
      values: avoided.configurations.map((one) => (one.measured?.value == null ? null : one.measured.value * 100)),
    },
    {
      mark: "predicted",
      label: words.predicted,
      values: avoided.configurations.map((one) => (one.predicted === null ? null : one.predicted * 100)),
    },
  ];
  if (names.length === 0) return null;
  return (
    <Figure
      title={words.byConfiguration}
      note={words.byConfigurationNote}
      legend={series}
      table={{
        columns: [
          text.deflection.configuration,
          ...alike([words.measured, text.run.uncertainty, words.predicted], text.units.share),
        ],
        rows: avoided.configurations.map((one, i) => [
          one.observation,
          series[0]?.values[i],
          one.measured?.standard_uncertainty == null ? null : one.measured.standard_uncertainty * 100,
          series[1]?.values[i],
        ]),
      }}
    >
      {(width) => (
        <Bars names={names} series={series} width={width} label={words.byConfiguration} unit={text.units.share} />
      )}
    </Figure>
  );
}
