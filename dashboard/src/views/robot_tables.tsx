/** The kinematics of a robot as tables: rows with limits, and the joint map. */
import type { DhModel, JointKind, JointMap } from "../api/types";
import { alike, DataTable } from "../components/table";
import { fixed } from "../lib/format";
import { degrees, position, positionUnit } from "../lib/units";
import { text } from "../i18n";
import { later } from "../i18n/later";

/** Millimetres and degrees without the noise of their factors. */
const plain = (value: number): string => String(Number(value.toFixed(6))).replace("-", "\u2212");

const limit = (value: number | null | undefined, kind: JointKind, unit: boolean): string =>
  value === null || value === undefined
    ? later.robots.unknown
    : `${fixed(position(value, kind), 0)}${unit ? positionUnit(kind) : ""}`;

export function RowsTable({ model }: { model: DhModel }) {
  const words = later.robots;
  const { mm, deg } = text.units;
  const slides = model.rows.some(({ kind }) => kind === "prismatic");
  return (
    <DataTable
      caption={words.table}
      table={{
        columns: [
          text.run.joint,
          { title: words.column.a, unit: mm, show: plain },
          { title: words.column.alpha, unit: deg, show: plain },
          { title: words.column.d, unit: mm, show: plain },
          { title: words.column.theta, unit: deg, show: plain },
          ...(slides ? [words.lower, words.upper] : alike([words.lower, words.upper], deg)),
        ],
        rows: model.rows.map((row, i) => [
          slides ? `${i + 1}, ${words.kinds[row.kind]}` : String(i + 1),
          row.a * 1e3,
          degrees(row.alpha),
          row.d * 1e3,
          degrees(row.theta),
          limit(row.lower, row.kind, slides),
          limit(row.upper, row.kind, slides),
        ]),
      }}
    />
  );
}

export function JointMapTable({ map, kinds }: { map: JointMap; kinds: JointKind[] }) {
  const words = later.robots;
  const joints = map.matrix.map((_, i) => ({ title: String(i + 1), show: plain }));
  return (
    <DataTable
      caption={words.mapTable}
      table={{
        columns: [text.run.joint, ...joints, { title: words.offset, show: plain }],
        rows: map.matrix.map((row, i) => [
          `${i + 1} [${positionUnit(kinds[i]).trim()}]`,
          ...row,
          position(map.offset[i] ?? 0, kinds[i]),
        ]),
      }}
    />
  );
}
