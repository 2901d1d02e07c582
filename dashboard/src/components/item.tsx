/** A row of a list: what, how, when, and how it stands. */
import type { ComponentChildren } from "preact";

export function Item({
  href,
  what,
  note,
  how,
  figures,
  when,
  standing,
  children,
}: {
  /** Address that the row leads to, if any. */
  href?: string | undefined;
  what: ComponentChildren;
  /** Beneath what. */
  note?: ComponentChildren;
  how?: ComponentChildren;
  figures?: ComponentChildren;
  when?: ComponentChildren;
  standing?: ComponentChildren;
  /** What can be done with it, beside the link. */
  children?: ComponentChildren;
}) {
  const cells = (
    <>
      <span class="what">
        {what}
        {note && <small>{note}</small>}
      </span>
      {how && <span class="how">{how}</span>}
      {figures}
      {when && <span class="when">{when}</span>}
      {standing && <span class="standing">{standing}</span>}
    </>
  );
  return (
    <li class="item">
      {href === undefined ? (
        <div class="main">{cells}</div>
      ) : (
        <a class="main" href={href}>
          {cells}
        </a>
      )}
      {children}
    </li>
  );
}
