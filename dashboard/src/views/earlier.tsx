/** Comparisons or pairs made before, newest first, and those that were deleted, to bring them back. */
import { useState } from "preact/hooks";
import { problemOf } from "../api/client";
import type { ComparisonSummary, Page, PairSummary } from "../api/types";
import { Badge } from "../components/badge";
import { Choice, Empty, Name, ProblemNote, State, When } from "../components/basics";
import { useLoad } from "../state/load";
import type { Names } from "../state/names";
import { link } from "../state/router";
import { toast } from "../state/toasts";
import { text } from "../i18n";
import { Figures } from "./run_list";

const words = text.compare;
const MOST = 50;

export function Earlier<Item extends ComparisonSummary | PairSummary>({
  kind,
  names,
  title,
  list,
  restore,
}: {
  kind: "methods" | "pairs";
  names: Names;
  title: (item: Item) => preact.ComponentChildren;
  list: (filters: Record<string, string | number>, signal: AbortSignal) => Promise<Page<Item>>;
  restore: (id: string) => Promise<unknown>;
}) {
  const [shown, setShown] = useState<"kept" | "deleted">("kept");
  const deleted = shown === "deleted";
  const found = useLoad((signal) => list({ limit: MOST, ...(deleted ? { deleted: "true" } : {}) }, signal), [shown]);
  const bringBack = (id: string) =>
    void restore(id).then(
      () => {
        toast(words.restored);
        found.reload();
      },
      (error: unknown) => toast(problemOf(error).detail),
    );
  const items = found.state === "ready" ? found.value.items : [];
  return (
    <section class="earlier">
      <div class="filters">
        <h2>{words.earlier}</h2>
        <Choice
          label={text.runs.state}
          value={shown}
          change={setShown}
          options={[
            { value: "kept", label: words.kept },
            { value: "deleted", label: text.lists.deleted },
          ]}
        />
      </div>
      {deleted && <p class="soft">{words.deletedHint}</p>}
      {found.state === "failed" && <ProblemNote problem={found.problem} retry={found.reload} />}
      {found.state === "ready" && items.length === 0 && (
        <Empty title={deleted ? words.noneDeleted : words.none} hint={deleted ? words.deletedHint : words.noneHint} />
      )}
      {items.length > 0 && (
        <ul class="rows">
          {items.map((item) => {
            const row = <Row item={item} names={names} title={title(item)} />;
            return (
              <li class="item">
                {deleted ? (
                  <div class="main">{row}</div>
                ) : (
                  <a class="main" href={link(["compare", kind, item.id])}>
                    {row}
                  </a>
                )}
                {deleted && (
                  <button type="button" class="button" onClick={() => bringBack(item.id)}>
                    {text.lists.restore}
                  </button>
                )}
              </li>
            );
          })}
        </ul>
      )}
    </section>
  );
}

function Row({
  item,
  names,
  title,
}: {
  item: ComparisonSummary | PairSummary;
  names: Names;
  title: preact.ComponentChildren;
}) {
  return (
    <>
      <span class="what">
        <span>{title}</span>
        <small>
          <Name>{names.robot(item.robot_id)}</Name>
        </small>
      </span>
      <Figures of={item} />
      <span class="when">
        <When time={item.created_at} />
      </span>
      <span class="standing">{item.verdict ? <Badge verdict={item.verdict} /> : <State state={item.state} />}</span>
    </>
  );
}
