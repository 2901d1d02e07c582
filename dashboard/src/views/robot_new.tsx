/** Adding a robot: a DH table or a URDF, drawn at once, stored when it looks right. */
import { useMemo, useState } from "preact/hooks";
import { api } from "../api/client";
import type { RobotDocument } from "../api/types";
import { Arm } from "../components/arm";
import { Choice, ProblemNote, Title } from "../components/basics";
import { contentKey } from "../lib/hash";
import { useAction } from "../state/action";
import { namesChanged } from "../state/names";
import { go, link } from "../state/router";
import { text } from "../i18n";
import { DhEditor, type DhTable, documentOf, newDh } from "./dh_editor";
import { type UrdfText, UrdfEditor } from "./urdf_editor";

type Format = "dh" | "urdf";

export function RobotNewView() {
  const words = text.robots;
  const [name, setName] = useState("");
  const [format, setFormat] = useState<Format>("dh");
  const [dh, setDh] = useState<DhTable>(newDh);
  const [urdf, setUrdf] = useState<UrdfText>({ urdf: "", base: "", flange: "" });
  const document = useMemo<RobotDocument | null>(() => {
    if (format === "dh") return documentOf(name.trim() || words.namePlaceholder, dh);
    if (!urdf.urdf || !urdf.base || !urdf.flange) return null;
    return { name: name.trim() || words.namePlaceholder, model: { format: "urdf", ...urdf }, joint_map: null };
  }, [name, format, dh, urdf]);
  const source = useMemo(
    () => document && { robot: { ...document, name: "drawn" } },
    [document && JSON.stringify({ ...document, name: "" })],
  );
  const save = useAction(async () => {
    if (!document) return;
    const named = { ...document, name: name.trim() };
    const robot = await api.addRobot(named, contentKey("robot", named));
    namesChanged();
    go(link(["robots", robot.id]));
  });
  return (
    <>
      <Title plain={words.add}>{words.add}</Title>
      <div class="flow editor">
        <section class="card">
          <label class="field">
            <span>{words.name}</span>
            <input
              type="text"
              maxLength={200}
              value={name}
              placeholder={words.namePlaceholder}
              onInput={(event) => setName(event.currentTarget.value)}
            />
          </label>
          <Choice
            label={words.description}
            value={format}
            change={setFormat}
            options={[
              { value: "dh", label: words.dh },
              { value: "urdf", label: words.urdf },
            ]}
          />
          {format === "dh" ? <DhEditor table={dh} change={setDh} /> : <UrdfEditor given={urdf} change={setUrdf} />}
        </section>
        <section class="card sticky">
          <h2>{words.draw}</h2>
          {source ? <Arm source={source} start={null} /> : <p class="stage blank">{text.start.armHere}</p>}
          {save.problem && <ProblemNote problem={save.problem} />}
          <div class="go">
            <button
              type="button"
              class="button primary big"
              disabled={!document || !name.trim() || save.busy}
              onClick={save.run}
            >
              {save.busy ? words.saving : words.save}
            </button>
          </div>
        </section>
      </div>
    </>
  );
}
