/** Jobs of a kind made before, newest first, and those that were deleted, to bring them back. */
import type { ComponentChildren } from "preact";
import { useState } from "preact/hooks";
import { api, problemOf } from "../api/client";
import type { Collection } from "../api/events";
import type { Page, RunState, RunSummary, Usability } from "../api/types";
import { Badge, VerdictFilter } from "../components/badge";
import { Button, Choice, Empty, Name, ProblemNote, State, When } from "../components/basics";
import { Item } from "../components/item";
import { useLoad } from "../state/load";
import type { Names } from "../state/names";
import { link } from "../state/router";
import { toast } from "../state/toasts";
import { text } from "../i18n";
import { Figures } from "./run_list";

const words = text.earlier;
const MOST = 50;

type Listed = Exclude<Collection, "runs">;
type Summary<Of extends Listed> = Awaited<ReturnType<(typeof api)[Of]["list"]>>["items"][number];

/** What has numbers of joints has all that is told of a run. */
interface Listing {
  id: string;
  robot_id: string | null;
  state: RunState;
  created_at: string;
  verdict?: Usability | null;
  joint_count?: number | null;
}

const addressOf = (collection: Listed, id: string): string =>
  collection === "comparisons"
    ? link(["compare", "methods", id])
    : link(collection === "pairs" ? ["compare", "pairs", id] : [collection, id]);

export function Earlier<Of extends Listed>({
  collection,
  filters = {},
  names,
  title,
}: {
  collection: Of;
  filters?: Record<string, string>;
  names: Names | null;
  title: (item: Summary<Of>) => ComponentChildren;
}) {
  const [shown, setShown] = useState<"kept" | "deleted">("kept");
  const [verdict, setVerdict] = useState<Usability | "">("");
  const deleted = shown === "deleted";
  const found = useLoad(
    (signal) => {
      const judged = verdict === "" ? {} : { verdict };
      const wanted = { ...filters, ...judged, limit: MOST, ...(deleted ? { deleted: "true" } : {}) };
      return api[collection].list(wanted, signal) as Promise<Page<Listing & Summary<Of>>>;
    },
    [shown, verdict, JSON.stringify(filters)],
  );
  const bringBack = (id: string) =>
    void api[collection].restore(id).then(
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
        <h2>{words.of[collection]}</h2>
        <Choice
          label={text.runs.state}
          value={shown}
          change={setShown}
          options={[
            { value: "kept", label: words.kept },
            { value: "deleted", label: text.lists.deleted },
          ]}
        />
        <VerdictFilter value={verdict} change={setVerdict} />
      </div>
      {deleted && <p class="soft">{words.deletedHint}</p>}
      {found.state === "failed" && <ProblemNote problem={found.problem} retry={found.reload} />}
      {found.state === "ready" && items.length === 0 && (
        <Empty title={deleted ? words.noneDeleted : words.none} hint={deleted ? words.deletedHint : words.noneHint} />
      )}
      {items.length > 0 && (
        <ul class="rows">
          {items.map((item) => (
            <Item
              href={deleted ? undefined : addressOf(collection, item.id)}
              what={<span>{title(item)}</span>}
              note={item.robot_id !== null && <Name>{names?.robot(item.robot_id) ?? "…"}</Name>}
              figures={item.verdict && item.joint_count && <Figures of={item as RunSummary} />}
              when={<When time={item.created_at} />}
              standing={item.verdict ? <Badge verdict={item.verdict} /> : <State state={item.state} />}
            >
              {deleted && <Button onClick={() => bringBack(item.id)}>{text.lists.restore}</Button>}
            </Item>
          ))}
        </ul>
      )}
    </section>
  );
}
