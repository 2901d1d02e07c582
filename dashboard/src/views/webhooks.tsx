/** For admins: the addresses that are told what happens, and the messages that did not arrive. */
import { useState } from "preact/hooks";
import { api } from "../api/client";
import type { NewWebhook, Webhook } from "../api/types";
import { ActionButton, Button, Empty, ProblemNote, Show, timeText, Title } from "../components/basics";
import { type Row, Rows } from "../components/list";
import { SchemaFields } from "../components/schema_form";
import { TableCard } from "../components/table";
import type { Fields } from "../lib/json";
import { useAction } from "../state/action";
import { useLoad } from "../state/load";
import { text } from "../i18n";
import { later } from "../i18n/later";

const words = later.webhooks;

export function WebhooksView() {
  const hooks = useLoad((signal) => api.webhooks(signal), []);
  const [asked, setAsked] = useState<Fields>({});
  const [made, setMade] = useState<NewWebhook | null>(null);
  const add = useAction(async () => {
    const { events } = asked as { events?: string[] };
    setMade(await api.addWebhook({ ...asked, events: events?.length ? events : undefined }));
    setAsked({});
    hooks.reload();
  });
  const remove = useAction(async (hook: Webhook) => {
    if (!confirm(words.sure(hook.url))) return;
    await api.deleteWebhook(hook.id);
    hooks.reload();
  });
  return (
    <>
      <Title plain={text.app.webhooks}>{text.app.webhooks}</Title>
      <section class="card form">
        <p>{words.intro}</p>
        <SchemaFields
          of="WebhookRequest"
          show={["url", "events"]}
          value={asked}
          change={setAsked}
          terms={{ labels: words.labels }}
        />
        <ActionButton look="primary" action={add} disabled={!asked["url"]}>
          {words.add}
        </ActionButton>
        {made && (
          <p class="note good">
            {words.secret} <code>{made.secret}</code>
          </p>
        )}
      </section>
      {remove.problem && <ProblemNote problem={remove.problem} />}
      <Show
        of={hooks}
        instead={({ items }) => items.length === 0 && <Empty title={words.none} hint={words.noneHint} />}
      >
        {({ items }) => (
          <>
            <div class="fleet">
              <Rows rows={items.map((hook) => rowOf(hook, () => remove.run(hook)))} />
            </div>
            <Undelivered hooks={items} />
          </>
        )}
      </Show>
    </>
  );
}

function rowOf(hook: Webhook, remove: () => void): Row {
  const [latest] = hook.undelivered;
  const state = !latest ? "succeeded" : latest.state === "dead" ? "failed" : "queued";
  return {
    id: hook.id,
    name: hook.url,
    note: words.delivered(hook.delivered),
    how: hook.events.map((event) => words.events[event]).join(", "),
    at: hook.created_at,
    standing: <span class={`state ${state}`}>{words.states[latest?.state ?? "delivered"]}</span>,
    actions: (
      <Button look="quiet" aria-label={`${text.run.delete}: ${hook.url}`} onClick={remove}>
        {text.run.delete}
      </Button>
    ),
  };
}

function Undelivered({ hooks }: { hooks: Webhook[] }) {
  const rows = hooks.flatMap(({ url, undelivered }) =>
    undelivered.map((one) => [
      url,
      words.events[one.type],
      words.states[one.state],
      timeText(one.created_at),
      String(one.attempts),
      one.error ?? words.notYet,
    ]),
  );
  if (rows.length === 0) return null;
  return <TableCard title={words.undelivered} table={{ columns: words.columns.map((title) => ({ title })), rows }} />;
}
