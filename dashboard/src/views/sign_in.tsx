/** Signing in: a key is entered once, or comes with a one-time link. */
import { useCallback, useEffect, useState } from "preact/hooks";
import { api } from "../api/client";
import type { Session } from "../api/types";
import { Busy, Form, Prose, Title } from "../components/basics";
import { TextField } from "../components/fields";
import { useAction } from "../state/action";
import { go } from "../state/router";
import { text } from "../i18n";

/** `link`: secret of a one-time link, which leaves the address before it is used. */
export function SignInView({ link, signedIn }: { link: string | undefined; signedIn: (session: Session) => void }) {
  const [key, setKey] = useState("");
  const { run, busy, problem } = useAction(
    useCallback(
      async (secret: { key: string } | { link: string }) => {
        const session = await api.signIn(secret);
        if (location.hash.startsWith("#/sign-in")) go("#/");
        signedIn(session);
      },
      [signedIn],
    ),
  );
  useEffect(() => {
    if (link === undefined) return;
    history.replaceState(null, "", "#/sign-in");
    run({ link });
  }, [link]);
  const enter = { run: () => void (key.trim() && run({ key: key.trim() })), busy, problem };
  const { signIn: words } = text;
  return (
    <>
      <Title plain={words.title}>{words.title}</Title>
      <Form action={enter} class="card form">
        <p>
          <Prose text={words.hint} />
        </p>
        <TextField type="password" label={words.key} maxLength={200} value={key} placeholder="jst_…" change={setKey} />
        {busy && <Busy label={words.checking} />}
        <button type="submit" class="button primary" disabled={busy || !key.trim()}>
          {words.enter}
        </button>
      </Form>
    </>
  );
}
