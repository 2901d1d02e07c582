/** The wall: robots by joints, coloured by how significant their change is, worst first; a tap leads to the trend. */
import { queries } from "../../api/queries";
import { Busy, Button, Empty, LinkButton, MeasureLink, Name, ProblemNote } from "../../components/basics";
import { EstimateValue } from "../../components/estimate";
import { shownChange } from "../../lib/estimate";
import { dayText } from "../../lib/format";
import { link } from "../../state/action";
import { usePages, useQuery } from "../../state/query";
import { text } from "../../words";
import { changeText } from "../trend/trend";
import { significanceOf, type WallCell, type WallRow, wallOf } from "./rows";
import { wallWords as words } from "./words";

/** Marks of cells without a change. */
const [SAME, UNTESTED] = ["=", "?"];

/** From so many standard uncertainties on, the colour is full. */
const FULL = 10;

const NoArms = () => (
  <Empty title={words.none} hint={words.noneHint}>
    <MeasureLink />
  </Empty>
);

/** The worst arms, with a link to all of them; nothing before a robot was measured. */
export function WorstArms({ most, title }: { most: number; title: string }) {
  const { data: page } = useQuery(queries.worstRobots(most));
  const rows = wallOf(page?.items ?? []);
  if (rows.length === 0) return null;
  return (
    <>
      <h3>{title}</h3>
      <WallTable rows={rows.slice(0, most)} />
      {(rows.length > most || page?.next) && (
        <LinkButton look="quiet" href="#/wall">
          {words.all}
        </LinkButton>
      )}
    </>
  );
}

/** The wall of all arms: a page of robots, and more where one asks for them. */
export function Wall() {
  const found = usePages(queries.everyRobot);
  if (found.problem) return <ProblemNote problem={found.problem} retry={found.refetch} />;
  if (!found.data) return <Busy />;
  const rows = wallOf(found.data.flatMap(({ items }) => items));
  if (rows.length === 0) return <NoArms />;
  const last = found.data.at(-1)?.items.at(-1); // robots without an arm come last
  return (
    <>
      <WallTable rows={rows} />
      {found.more && last && last.arms.length > 0 && <Button onClick={found.more}>{text.app.more}</Button>}
    </>
  );
}

/** As many joints have room beside their robot; the columns of more are scrolled. */
const MOST_JOINTS = 9;

export function WallTable({ rows }: { rows: WallRow[] }) {
  const width = Math.max(0, ...rows.map(({ cells }) => cells.length));
  const isWide = width > MOST_JOINTS;
  const columns = Array.from({ length: width }, (_, i) => i);
  return (
    <div class="card walled">
      <div class={isWide ? "scroll" : ""} {...(isWide ? { tabIndex: 0 } : {})}>
        <table class={isWide ? "wall many" : "wall"} aria-label={words.wall} style={{ "--joints": String(width) }}>
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
      <p class="soft key">
        <span>
          <b>{SAME}</b> {words.sameShort}
        </span>
        <span>
          <b>{UNTESTED}</b> {words.untestedShort}
        </span>
        <span>{words.colours}</span>
      </p>
    </div>
  );
}

function Cell({ cell, row }: { cell: WallCell | undefined; row: WallRow }) {
  if (!cell) return <td />;
  const { joint, change, tested } = cell;
  if (!change)
    return (
      <td class={tested ? "same" : "untested"} title={tested ? words.same(joint) : words.untested(joint)}>
        {tested ? SAME : UNTESTED}
        <span class="hidden">{tested ? words.sameShort : words.untestedShort}</span>
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
