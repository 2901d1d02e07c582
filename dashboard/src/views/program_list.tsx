/** Compensated programs of a robot, newest first. */
import { api } from "../api/client";
import { Name, State, When } from "../components/basics";
import { useLoad, valueOf } from "../state/load";
import { link } from "../state/router";
import { text } from "../i18n";

const SHOWN = 20;

export function ProgramList({ robot }: { robot: string }) {
  const found = useLoad((signal) => api.programs.list({ robot_id: robot, limit: SHOWN }, signal), [robot]);
  const items = valueOf(found)?.items ?? [];
  if (items.length === 0) return null;
  return (
    <section class="card">
      <h2>{text.program.listed}</h2>
      <ul>
        {items.map((one) => (
          <li>
            <a href={link(["programs", one.id])}>
              <Name>{one.file_name ?? text.program.kind}</Name>
            </a>{" "}
            <When time={one.created_at} /> {one.state !== "succeeded" && <State state={one.state} />}
          </li>
        ))}
      </ul>
    </section>
  );
}
