/** Deflection of each configuration before and after compensation (the paper's Figs 7 and 8), and what remains. */
import { useMemo } from "preact/hooks";
import type { Residual, Run, RunResult } from "../api/types";
import { BarFigure, ByName, circle, type Opening } from "../charts/bars";
import { Figure } from "../charts/figure";
import { LinkButton } from "../components/basics";
import { significant } from "../lib/format";
import { extent } from "../lib/scale";
import { norm } from "../lib/vector";
import { link } from "../state/router";
import { text } from "../i18n";
import type { RunContext } from "./run_context";

const AXES = ["x", "y", "z"] as const;

/** Mean lengths over the targets of each observation [m], in the order of the observations. */
export function byObservation(residuals: Residual[]): { name: string; before: number; after: number }[] {
  const sums = new Map<string, { before: number; after: number; count: number }>();
  for (const { observation, deflection, residual } of residuals) {
    const sum = sums.get(observation) ?? { before: 0, after: 0, count: 0 };
    sums.set(observation, {
      before: sum.before + norm(deflection),
      after: sum.after + norm(residual),
      count: sum.count + 1,
    });
  }
  return [...sums].map(([name, { before, after, count }]) => ({ name, before: before / count, after: after / count }));
}

export function DeflectionPart({
  context,
  result,
  at,
}: {
  context: RunContext;
  result: RunResult;
  /** The configuration that was come back from. */
  at: string | null;
}) {
  const opening: Opening = {
    open: (observation) => link(["runs", context.run.id, "robot"], { at: observation, from: "deflection" }),
    at,
  };
  return (
    <>
      <BeforeAfter result={result} run={context.run} opening={opening} />
      <div class="actions">
        <LinkButton href={link(["compare", "methods"], { set: context.set.id })}>{text.sets.compare}</LinkButton>
      </div>
      {result.contributions.length > 0 && (
        <BarFigure
          title={text.deflection.byConfiguration}
          note={text.deflection.byConfigurationNote}
          names={[...new Set(result.residuals.map((r) => r.observation))]}
          series={result.contributions.map(({ joint, by_observation: lengths }, j) => ({
            label: joint,
            mark: `joint-${j % 6}`,
            values: lengths.map((length) => length * 1e3),
          }))}
          unit={text.units.mm}
          stacked
          {...opening}
        />
      )}
      <Residuals result={result} opening={opening} />
    </>
  );
}

function BeforeAfter({ result, run, opening }: { result: RunResult; run: Run; opening: Opening }) {
  const words = text.deflection;
  const rows = useMemo(() => byObservation(result.residuals), [result]);
  const names = rows.map((row) => row.name);
  const own = words.afterBy(text.methods[run.request.method].toLowerCase());
  const series = [
    { mark: "measured", label: words.before, values: rows.map((row) => row.before * 1e3) },
    { mark: "predicted", label: own, values: rows.map((row) => row.after * 1e3) },
  ];
  return <BarFigure title={words.title} note={words.note} unit={text.units.mm} {...{ names, series }} {...opening} />;
}

function Residuals({ result, opening }: { result: RunResult; opening: Opening }) {
  const words = text.deflection;
  const names = useMemo(() => [...new Set(result.residuals.map((r) => r.observation))], [result]);
  const column = new Map(names.map((name, i) => [name, i]));
  const band = result.sigma === null ? null : 1.96 * Math.SQRT2 * result.sigma * 1e6;
  const dots = result.residuals.flatMap((r) =>
    AXES.map((axis, k) => ({
      column: column.get(r.observation) ?? 0,
      value: (r.residual[k] ?? 0) * 1e6,
      mark: axis,
      title: `${r.target}, ${axis}: ${significant((r.residual[k] ?? 0) * 1e6, 3)} ${text.units.micrometre}`,
    })),
  );
  const um = text.units.micrometre;
  return (
    <Figure
      title={words.residuals}
      note={words.residualsNote}
      legend={[
        ...AXES.map((axis) => ({ label: axis, mark: axis })),
        ...(band === null ? [] : [{ label: `${words.band} = ${significant(band, 2)} ${um}`, mark: "band" }]),
      ]}
      table={{
        columns: [
          words.configuration,
          words.target,
          ...AXES.map((axis) => ({ title: `${words.length} ${axis}`, unit: um })),
          ...AXES.map((axis) => ({ title: `${words.residual} ${axis}`, unit: um })),
        ],
        rows: result.residuals.map((r) => [
          r.observation,
          r.target,
          ...r.deflection.map((v) => v * 1e6),
          ...r.residual.map((v) => v * 1e6),
        ]),
      }}
    >
      {(width) => (
        <Scatter names={names} dots={dots} band={band} width={width} label={words.residuals} unit={um} {...opening} />
      )}
    </Figure>
  );
}

interface Dot {
  column: number;
  value: number;
  mark: string;
  title: string;
}

export function Scatter({
  dots,
  band,
  ...frame
}: {
  names: string[];
  dots: Dot[];
  /** Half width of the band, or null. */
  band: number | null;
  width: number;
  label: string;
  unit: string;
} & Opening) {
  const reach = Math.max(...(extent(dots.map((dot) => dot.value)) ?? [0, 1]).map(Math.abs), band ?? 0) || 1;
  const lines = (i: number) => dots.filter((dot) => dot.column === i).map((dot) => dot.title);
  return (
    <ByName {...frame} height={280} range={[-reach, reach]} lines={lines}>
      {(place, step, y) => (
        <>
          {band !== null && (
            <rect
              class="band"
              x={place(-0.5)}
              width={step * frame.names.length}
              y={y(band)}
              height={y(-band) - y(band)}
            />
          )}
          {[...new Set(dots.map(({ mark }) => mark))].map((mark) => (
            <path
              class={`dot ${mark}`}
              d={dots
                .filter((dot) => dot.mark === mark)
                .map(({ column, value }) =>
                  circle(place(column) + shift(mark) * Math.min(5, step / 4), y(value), radius(step)),
                )
                .join("")}
            />
          ))}
        </>
      )}
    </ByName>
  );
}

const radius = (step: number): number => Math.min(3.6, Math.max(1.5, step / 5));
const shift = (mark: string): number => (mark === "x" ? -1 : mark === "z" ? 1 : 0);
