/** The robot that was measured: the newest few in view, the others in a list, or a new one. */
import { useState } from "preact/hooks";
import type { RobotSummary } from "../api/types";
import { Choice, LinkButton } from "../components/basics";
import { Select } from "../components/fields";
import { text } from "../i18n";

/** As many are in view. */
const IN_VIEW = 4;
const OTHERS = "others";

export function RobotChoice({
  robots,
  label,
  value,
  change,
}: {
  robots: RobotSummary[];
  /** What a robot is called here, so that those of one name are told apart. */
  label: (id: string) => string;
  value: string;
  change: (robot: string) => void;
}) {
  const few = robots.slice(0, IN_VIEW);
  const [listed, setListed] = useState(false);
  const others = robots.length > IN_VIEW;
  const inList = listed || (value !== "" && !few.some(({ id }) => id === value));
  return (
    <>
      {few.length > 0 && (
        <Choice
          label={text.start.robot}
          value={inList && others ? OTHERS : value}
          change={(robot) => {
            setListed(robot === OTHERS);
            change(robot === OTHERS ? "" : robot);
          }}
          options={[
            ...few.map(({ id }) => ({ value: id, label: label(id) })),
            ...(others ? [{ value: OTHERS, label: text.imports.otherRobot }] : []),
          ]}
        />
      )}
      <div class="row">
        {inList && others && (
          <Select
            label={text.imports.otherRobot}
            value={value}
            change={change}
            options={[
              { value: "", label: text.start.pick },
              ...robots.slice(IN_VIEW).map(({ id }) => ({ value: id, label: label(id) })),
            ]}
          />
        )}
        <LinkButton href="#/robots/new">{text.robots.add}</LinkButton>
      </div>
    </>
  );
}
