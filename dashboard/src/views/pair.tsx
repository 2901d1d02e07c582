/** Two sets side by side: stiffness ratios with intervals, and the deflection that the second avoids. */
import { api } from "../api/client";
import type { Pair } from "../api/types";
import { Bars } from "../charts/bars";
import { Figure } from "../charts/figure";
import { Intervals } from "../charts/intervals";
import { Name, ProblemNote, Show, State, Title, Warnings, When } from "../parts/basics";
import { DataTable } from "../parts/table";
import { percent, pValue, significant } from "../pure/format";
import { axisStiffness } from "../pure/stiffness";
import { STIFFNESS_UNITS } from "../pure/units";
import { useLoad } from "../state/load";
import { link } from "../state/router";
import { useSettings } from "../state/settings";
import { text } from "../text";
import { markOf } from "./run_stiffness";

const words = text.pair;
type Result = NonNullable<Pair["result"]>;

const sideOf = (side: Pair["request"]["first"]): string =>
  side.run_id ? `run:${side.run_id}` : `set:${side.measurement_set_id ?? ""}`;

export function PairView({ id }: { id: string }) {
  const loaded = useLoad(
    async (signal) => {
      const pair = await api.pair(id, signal);
      const [first, second] = await Promise.all([
        api.set(pair.first_set_id, signal),
        api.set(pair.second_set_id, signal),
      ]);
      return { pair, first: first.name, second: second.name };
    },
    [id],
  );
  return (
    <Show of={loaded} title={words.kind}>
      {({ pair, first, second }) => (
        <>
          <div class="head">
            <Title kind={words.kind} plain={words.title(first, second)}>
              <Name>{first}</Name> → <Name>{second}</Name>
            </Title>
            <p class="meta">
              <State state={pair.state} />
              <a href={link(["sets", pair.first_set_id])}>{words.first}</a>
              <a href={link(["sets", pair.second_set_id])}>{words.second}</a>
              <When time={pair.provenance.created_at} />
            </p>
            <div class="actions">
              <a
                class="button"
                href={link(["compare", "pairs"], {
                  first: sideOf(pair.request.second),
                  second: sideOf(pair.request.first),
                })}
              >
                {words.swap}
              </a>
            </div>
          </div>
          {pair.error && <ProblemNote problem={pair.error} />}
          {pair.result && (
            <PairPage
              result={pair.result}
              level={percent(pair.request.confidence ?? pair.request.options?.confidence ?? 0.95)}
            />
          )}
        </>
      )}
    </Show>
  );
}

function PairPage({ result, level }: { result: Result; level: string }) {
  return (
    <>
      {result.warnings.length > 0 && (
        <>
          <h2>{text.run.warnings(result.warnings.length)}</h2>
          <Warnings warnings={result.warnings} />
        </>
      )}
      <Avoided result={result} />
      <Ratios result={result} level={level} />
      <Both result={result} level={level} />
      <ByConfiguration result={result} />
      {result.ordered && <Ordered result={result} />}
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

function Ratios({ result, level }: { result: Result; level: string }) {
  const show = (v: number) => significant(v, 3);
  return (
    <Figure
      title={words.ratio}
      note={words.ratioNote(level)}
      table={{
        columns: [
          { title: text.run.joint },
          { title: words.ratio, show },
          { title: text.run.low, show },
          { title: text.run.high, show },
          { title: words.p, show: pValue },
          { title: text.run.verdict },
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
                instead: joint.reason ?? "–",
                label: `${joint.name}: ${joint.ratio === null ? "–" : show(joint.ratio)}`,
              },
            ],
          }))}
          width={width}
          label={words.ratio}
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

function Both({ result, level }: { result: Result; level: string }) {
  const { unit } = useSettings();
  const { factor, column, label } = STIFFNESS_UNITS[unit];
  const scaled = (value: number | null | undefined) => (value === null || value === undefined ? null : value * factor);
  const u = { unit: column };
  return (
    <Figure
      title={words.stiffness}
      note={text.run.stiffnessNote(level)}
      legend={[
        { label: words.first, mark: "method-1" },
        { label: words.second, mark: "method-0" },
      ]}
      table={{
        columns: [
          { title: text.run.joint },
          ...[words.first, words.second].flatMap((side) => [
            { title: side, ...u },
            { title: `${side} ${text.run.low}`, ...u },
            { title: `${side} ${text.run.high}`, ...u },
          ]),
        ],
        rows: result.joints.map((joint) => [
          joint.name,
          ...[joint.first, joint.second].flatMap((side) => [
            scaled(side.stiffness),
            scaled(side.stiffness_interval?.[0]),
            scaled(side.stiffness_interval?.[1]),
          ]),
        ]),
      }}
    >
      {(width) => (
        <Intervals
          rows={result.joints.map((joint) => ({
            name: joint.name,
            marks: [markOf(joint.first, "method-1", unit), markOf(joint.second, "method-0", unit)],
          }))}
          width={width}
          label={words.stiffness}
          unit={label}
          format={axisStiffness(unit)}
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
          { title: text.deflection.configuration },
          { title: words.measured, unit: text.units.share },
          { title: text.run.uncertainty, unit: text.units.share },
          { title: words.predicted, unit: text.units.share },
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

function Ordered({ result: { ordered } }: { result: Result }) {
  const { unit } = useSettings();
  const { factor, column } = STIFFNESS_UNITS[unit];
  if (!ordered) return null;
  const scaled = (value: number | null) => (value === null ? null : value * factor);
  return (
    <section class="card">
      <h2>{words.ordered}</h2>
      <p class="soft">
        {words.increase} {significant(ordered.chi_square_increase, 2)}
      </p>
      <DataTable
        caption={words.ordered}
        table={{
          columns: [
            { title: text.run.joint },
            { title: words.first, unit: column },
            { title: words.second, unit: column },
            { title: "" },
          ],
          rows: ordered.joints.map((joint) => [
            joint.name,
            scaled(joint.stiffness_first),
            scaled(joint.stiffness_second),
            joint.equal ? words.heldEqual : "",
          ]),
        }}
      />
    </section>
  );
}
