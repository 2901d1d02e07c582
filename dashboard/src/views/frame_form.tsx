/** The frame of the positions, where it is a tracker's: by a geometry of the robot, or by a transform. */
import { api } from "../api/client";
import type { Problem } from "../api/types";
import { Choice } from "../components/basics";
import { Faults, VectorField, Select } from "../components/fields";
import { faultsAt } from "../lib/faults";
import type { StatedFrame } from "../lib/frame";
import { useLoad, valueOf } from "../state/load";
import { text } from "../i18n";

const words = text.frame;

export function FrameForm({
  frame,
  change,
  robot,
  length,
  problem,
}: {
  frame: StatedFrame;
  change: (frame: StatedFrame) => void;
  /** Whose geometries are offered; empty while none is chosen. */
  robot: string;
  /** The files' unit of length. */
  length: string;
  problem: Problem | null;
}) {
  const set = (part: Partial<StatedFrame>) => change({ ...frame, ...part });
  const geometries = valueOf(
    useLoad(
      async (signal) =>
        robot ? (await api.geometries.list({ robot_id: robot, state: "succeeded", limit: 20 }, signal)).items : [],
      [robot],
    ),
  );
  return (
    <div class="import-form">
      <Select
        label={words.positions}
        help={words.help}
        value={frame.of}
        change={(of) => set({ of })}
        options={[
          { value: "", label: words.base },
          ...(geometries ?? []).map(({ id, name }) => ({ value: id, label: words.geometry(name) })),
          { value: "transform", label: words.transform },
        ]}
      />
      {frame.of === "transform" && (
        <>
          <VectorField
            label={words.origin}
            unit={length}
            value={frame.translation}
            change={(translation) => set({ translation })}
            faults={faultsAt(problem, "frame.translation")}
          />
          {frame.rows.map((row, i) => (
            <VectorField
              label={words.row(i + 1)}
              value={row}
              change={(typed) =>
                set({ rows: frame.rows.map((old, j) => (j === i ? typed : old)) as StatedFrame["rows"] })
              }
              faults={i === 2 ? faultsAt(problem, "frame.rotation") : []}
            />
          ))}
        </>
      )}
      {frame.of !== "" && (
        <>
          <Choice
            label={words.forces}
            value={frame.forces}
            change={(forces) => set({ forces })}
            options={[
              { value: "base", label: words.forcesBase },
              { value: "tracker", label: words.forcesTracker },
            ]}
          />
          <p class="soft">{words.later}</p>
          <Faults faults={faultsAt(problem, "frame.geometry_id")} />
        </>
      )}
    </div>
  );
}
