/** The numbers of a geometry: links beside the nominal model, axes, and what each sweep says by itself. */
import type { GeometryResult } from "../api/types";
import { TableCard } from "../components/table";
import { fixed, significant } from "../lib/format";
import { degrees } from "../lib/units";
import { text } from "../i18n";

const words = text.geometry;
const { mm, deg, micrometre } = text.units;

const micro = (value: number | null): number | null => (value === null ? null : value * 1e6);
const two = (value: number) => significant(value, 2);
const digits = (count: number) => (value: number) => fixed(value, count);

export function LinkTables({ links }: { links: GeometryResult["links"] }) {
  if (links.length === 0) return <p class="soft">{words.noLinks}</p>;
  const rows = (unit: "m" | "rad", shown: (value: number) => number) =>
    links
      .filter((link) => link.unit === unit)
      .map((link) => [
        link.joint,
        words.quantities[link.quantity],
        shown(link.nominal),
        shown(link.identified),
        link.difference * 1e3,
        micro(link.standard_uncertainty),
      ]);
  const first = [{ title: text.run.joint }, { title: words.parameter }];
  return (
    <>
      <TableCard
        title={words.lengths}
        note={words.uncertaintyNote}
        table={{
          columns: [
            ...first,
            { title: words.nominalValue, unit: mm, show: digits(3) },
            { title: words.identifiedValue, unit: mm, show: digits(3) },
            { title: words.difference, unit: mm, show: digits(3) },
            { title: words.uncertainty, unit: micrometre, show: two },
          ],
          rows: rows("m", (value) => value * 1e3),
        }}
      />
      <TableCard
        title={words.angles}
        table={{
          columns: [
            ...first,
            { title: words.nominalValue, unit: deg, show: digits(4) },
            { title: words.identifiedValue, unit: deg, show: digits(4) },
            { title: words.difference, unit: words.mrad, show: digits(3) },
            { title: words.uncertainty, unit: words.microradian, show: two },
          ],
          rows: rows("rad", degrees),
        }}
      />
    </>
  );
}

export function AxisTable({ axes }: { axes: GeometryResult["axes"] }) {
  return (
    <TableCard
      title={words.axes}
      table={{
        columns: [
          { title: words.axis },
          ...["x", "y", "z"].map((title) => ({ title, unit: mm, show: digits(3) })),
          ...["x", "y", "z"].map((title) => ({ title: `${words.direction} ${title}`, show: digits(5) })),
          { title: words.uPosition, unit: micrometre, show: two },
          { title: words.uDirection, unit: words.microradian, show: two },
        ],
        rows: axes.map((axis) => [
          axis.name,
          ...axis.base.point.map((value) => value * 1e3),
          ...axis.base.direction,
          micro(axis.position_uncertainty),
          micro(axis.direction_uncertainty),
        ]),
      }}
    />
  );
}

export function SweepTable({ sweeps }: { sweeps: GeometryResult["sweeps"] }) {
  if (sweeps.length === 0) return null;
  return (
    <TableCard
      title={words.sweeps}
      table={{
        columns: [
          { title: text.run.joint },
          { title: words.positions, show: digits(0) },
          { title: words.arc, unit: deg, show: digits(1) },
          { title: words.angleScale, show: digits(5) },
          { title: words.chiSquare, show: digits(2) },
        ],
        rows: sweeps.map((sweep) => [
          sweep.joint,
          sweep.positions,
          degrees(sweep.arc),
          sweep.angle_scale,
          sweep.variance_factor,
        ]),
      }}
    />
  );
}
