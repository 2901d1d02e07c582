/** Pairing of a tracker with the form of an open set, and what the tracker reads. */
import type { BridgeReading } from "../../api/types";
import { ActionButton, Button } from "../../components/basics";
import { fixed, timeText } from "../../lib/format";
import type { Rows } from "./live";
import { vectorIn } from "../../lib/schema";
import { norm, subtract } from "../../lib/vector";
import { text } from "../../words";
import { copied, useAction } from "../../state/action";
import type { Bridge } from "./bridge";
import { measureWords } from "./words";

const words = measureWords.tracker;

/** The code of a bridge with the command that joins it, or that a tracker is joined. */
export function TrackerCard({ bridge }: { bridge: Bridge }) {
  const { paired, state } = bridge;
  const open = useAction(bridge.open);
  const end = useAction(bridge.end);
  const isJoined = state?.joined ?? false;
  const command =
    paired?.code && `jointstiff measure --bridge lines:/dev/ttyUSB0 --server ${location.origin} --code ${paired.code}`;
  return (
    <section class="card">
      <details open={paired !== null && !isJoined}>
        <summary>
          {words.title} {isJoined && <small class="soft">{words.connected(state?.connected ?? false)}</small>}
        </summary>
        <p class="soft">{words.about}</p>
        {command && !isJoined && (
          <>
            <p>
              {words.code} <output class="pairing">{paired.code}</output>{" "}
              <small class="soft">{words.ends(timeText(paired.ends_at))}</small>
            </p>
            <pre class="command">{command}</pre>
          </>
        )}
        <div class="row">
          {command && !isJoined && (
            <Button onClick={() => copied(command, words.copy, words.copied)}>{words.copy}</Button>
          )}
          {!isJoined && (
            <ActionButton action={open} going={text.start.going} {...(paired ? { look: "quiet" } : {})}>
              {paired ? words.newCode : words.pair}
            </ActionButton>
          )}
          {Object.keys(bridge.names).length > 0 && (
            <Button look="quiet" onClick={() => bridge.rename({})}>
              {words.askAgain}
            </Button>
          )}
          {paired && (
            <ActionButton action={end} going={text.start.going} look="quiet">
              {words.end}
            </ActionButton>
          )}
        </div>
      </details>
    </section>
  );
}

interface SaidProps {
  reading: BridgeReading;
  connected: boolean;
  rows: Rows;
  /** Whether the positions under the load are read. */
  loaded: boolean;
}

/** What the tracker reads at present, in one line. */
export function TrackerSaid({ reading: { trouble, points }, connected, rows, loaded }: SaidProps) {
  const targets = Object.keys(rows);
  const moved = targets.flatMap((target) => {
    const [before, after] = [vectorIn(rows[target]?.unloaded ?? ""), vectorIn(rows[target]?.loaded ?? "")];
    return loaded && before && after ? [norm(subtract(after, before))] : [];
  });
  const far = moved.length > 0 ? `${fixed(Math.max(...moved), 2)} ${text.units.mm}` : null;
  const said = connected ? (trouble ?? words.reads(Object.keys(points).length, targets.length, far)) : words.away;
  return (
    <p class={trouble || !connected ? "tracker wrong" : "tracker"} role="status" title={said}>
      {said}
    </p>
  );
}
