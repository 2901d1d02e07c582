/** The start: files, or a stored set, to their result. */
import { useEffect, useState } from "preact/hooks";
import { api } from "../api/client";
import { AlarmNote } from "../components/alarm";
import { Busy, Button, Empty, Head, LinkButton, ProblemNote } from "../components/basics";
import { handOver, keepFiles, keptBefore, keptFiles, type Opened, open } from "../state/opened";
import { useLoad, valueOf } from "../state/load";
import { useNames } from "../state/names";
import { go, link } from "../state/router";
import { text } from "../i18n";
import { later } from "../i18n/later";
import { CampaignFlow } from "./campaign_flow";
import { ImportFlow } from "./import_flow";
import { OpenCampaigns, TrySimulated } from "./measure";
import { RunList } from "./runs";

export function StartView({ query }: { query: URLSearchParams }) {
  const asked = query.get("set") ?? "";
  const [opened, setOpened] = useState<Opened | null>(() => (asked ? null : keptFiles()));
  const [count, setCount] = useState(0);
  useEffect(() => {
    if (!asked && !opened) void keptBefore().then((before) => before && setOpened((now) => now ?? before));
  }, []);
  const take = async (...files: File[]) => {
    const read = await open(files, opened);
    if (read.kind === "sweeps") {
      handOver(read.file);
      return go("#/geometries");
    }
    keepFiles(read);
    setOpened(read);
    setCount((before) => before + 1);
  };
  const robot = query.get("robot") ?? "";
  const names = valueOf(useNames());
  return (
    <>
      <Head
        plain={text.app.measure}
        title={text.start.title}
        first={
          <>
            <LinkButton href={link(["measure"])}>{later.measure.title}</LinkButton>
            <TrySimulated />
          </>
        }
      />
      <OpenCampaigns />
      {names?.robots.map(({ id, alarms }) => (
        <AlarmNote key={id} robot={id} name={names.robot(id)} alarms={alarms} />
      ))}
      {opened?.kind === "tables" ? (
        <ImportFlow key={count} opened={opened} robot={robot} take={(...files) => void take(...files)} />
      ) : (
        <CampaignFlow opened={opened} robot={robot} set={asked} take={(...files) => void take(...files)} />
      )}
      <section aria-labelledby="recent">
        <h2 id="recent">{text.start.recent}</h2>
        <Recent example={async () => take(await example())} />
      </section>
    </>
  );
}

/** A campaign to try the page with, of a robot that it brings along. */
async function example(): Promise<File> {
  const answer = await fetch(new URL("../example.json", import.meta.url));
  return new File([await answer.blob()], "example.json");
}

function Recent({ example }: { example: () => Promise<void> }) {
  const recent = useLoad((signal) => api.runs.list({ limit: 5 }, signal), []);
  const names = valueOf(useNames());
  if (recent.state === "loading") return <Busy />;
  if (recent.state === "failed") return <ProblemNote problem={recent.problem} retry={recent.reload} />;
  if (recent.value.items.length === 0)
    return (
      <Empty title={text.runs.none} hint={text.start.recentNone}>
        <Button onClick={() => void example()}>{text.start.example}</Button>
      </Empty>
    );
  return <RunList runs={recent.value.items} names={names} />;
}
