/** The wall: robots by joints, coloured by how significant their change is, worst first; a tap leads to the trend. */
import { queries } from "../../api/queries";
import { Empty, LinkButton, MeasureLink, Name, Show } from "../../components/basics";
import { EstimateValue } from "../../components/estimate";
import { shownChange } from "../../lib/estimate";
import { dayText } from "../../lib/format";
import { link } from "../../state/action";
import { useQuery } from "../../state/query";
import { text } from "../../words";
import { changeText } from "../trend/trend";
import { significanceOf, type WallCell, type WallRow, wallOf } from "./rows";
import { fleetWords as words } from "./words";

/** From so many standard uncertainties on, the colour is full. */
const FULL = 10;

/** The wall, or its first rows with a link to all. */
export function Wall({ most }: { most?: number }) {
  const robots = useQuery(queries.everyRobot);
  return (
    <Show
      of={robots}
      instead={(all) =>
        wallOf(all).length === 0 && (
          <Empty title={words.none} hint={words.noneHint}>
            <MeasureLink />
          </Empty>
        )
      }
    >
      {(all) => {
        const rows = wallOf(all);
        const shown = rows.slice(0, most);
        return (
          <>
            <WallTable rows={shown} />
            {shown.length < rows.length && (
              <LinkButton look="quiet" href="#/fleets">
                {words.all(rows.length)}
              </LinkButton>
            )}
          </>
        );
      }}
    </Show>
  );
}

export function WallTable({ rows }: { rows: WallRow[] }) {
  const width = Math.max(0, ...rows.map(({ cells }) => cells.length));
  const columns = Array.from({ length: width }, (_, i) => i);
  return (
    <div class="card walled">
      <table class="wall" aria-label={words.wall} style={{ "--joints": String(width) }}>
        <thead>
          <tr>
            <th scope="col">{text.app.robots}</th>
            {columns.map((i) => (
              <th scope="col">{words.joint(i + 1)}</th>
            ))}
            <th scope="col">{words.last}</th>
          </tr>
        </thead>
        <tbody>
          {rows.map((row) => (
            <tr>
              <th scope="row">
                <a href={link(["robots", row.robot])}>
                  <Name>{row.name}</Name>
                </a>
                {row.note && (
                  <small class="soft note-of">
                    <Name>{row.note}</Name>
                  </small>
                )}
                <small class="soft day" aria-hidden="true">
                  {dayText(row.at)}
                </small>
              </th>
              {columns.map((i) => (
                <Cell cell={row.cells[i]} row={row} />
              ))}
              <td class="when soft">{dayText(row.at)}</td>
            </tr>
          ))}
        </tbody>
      </table>
    </div>
  );
}

function Cell({ cell, row }: { cell: WallCell | undefined; row: WallRow }) {
  if (!cell) return <td />;
  const { joint, change } = cell;
  if (!change)
    return (
      <td class="same" title={words.same(joint)}>
        ·
      </td>
    );
  const strength = Math.min(1, significanceOf(change) / FULL);
  const to = link(["compare", "trend", row.robot], row.serial === null ? {} : { serial: row.serial });
  return (
    <td class={change.value < 0 ? "softer" : "stiffer"} style={{ "--strength": `${Math.round(100 * strength)}%` }}>
      <a href={to} title={`${joint}: ${changeText(change)}`}>
        <EstimateValue of={shownChange(change.value, change.standard_uncertainty)} unit={text.units.share} />
      </a>
    </td>
  );
}
