/** Adding a robot: an arm of the catalogue, a DH table or a URDF, drawn at once, stored when it looks right. */
import { DropZone } from "../components/drop";
import { Select, TextField } from "../components/fields";
import { useMemo, useState } from "preact/hooks";
import { api } from "../api/client";
import type { NominalArm, RobotDocument } from "../api/types";
import { Arm } from "../components/arm";
import { ActionButton, Button, Choice, Title } from "../components/basics";
import { contentKey } from "../lib/hash";
import { useAction } from "../state/action";
import { namesChanged } from "../state/names";
import { keptFiles } from "../state/opened";
import { link } from "../state/router";
import { text } from "../i18n";
import { later } from "../i18n/later";
import { ArmChooser, ArmFacts } from "./catalogue";
import { DhEditor, type DhTable, documentOf, newDh } from "./dh_editor";

type Format = "catalogue" | "dh" | "urdf";

export function RobotNewView() {
  const words = later.robots;
  const [name, setName] = useState("");
  const [format, setFormat] = useState<Format>("catalogue");
  const [arm, setArm] = useState<NominalArm | null>(null);
  const [dh, setDh] = useState<DhTable>(newDh);
  const [urdf, setUrdf] = useState<UrdfText>({ urdf: "", base: "", flange: "" });
  const document = useMemo<RobotDocument | null>(() => {
    if (format === "catalogue") {
      return arm && { name: name.trim() || arm.name, model: arm.model, joint_map: arm.joint_map };
    }
    if (format === "dh") return documentOf(name.trim() || words.namePlaceholder, dh);
    if (!urdf.urdf || !urdf.base || !urdf.flange) return null;
    return { name: name.trim() || words.namePlaceholder, model: { format: "urdf", ...urdf }, joint_map: null };
  }, [name, format, arm, dh, urdf]);
  const source = useMemo(
    () => document && { robot: { ...document, name: "drawn" } },
    [document && JSON.stringify({ ...document, name: "" })],
  );
  const save = useAction(async () => {
    if (!document) return;
    const named =
      format === "catalogue" && arm
        ? { name: document.name, model: { format: "catalogue" as const, arm: arm.name } }
        : { ...document, name: name.trim() };
    const robot = await api.robots.add(named, contentKey("robot", named));
    namesChanged();
    return keptFiles() ? link([], { robot: robot.id }) : link(["robots", robot.id]);
  });
  return (
    <>
      <Title plain={words.add}>{words.add}</Title>
      <div class="flow editor">
        <section class="card">
          <TextField
            label={words.name}
            maxLength={200}
            value={name}
            placeholder={format === "catalogue" && arm ? arm.name : words.namePlaceholder}
            change={setName}
          />
          <Choice
            look="choice cards"
            label={words.ways}
            value={format}
            change={setFormat}
            options={[
              { value: "catalogue", label: words.catalogue, hint: words.catalogueHint },
              { value: "dh", label: words.dh, hint: words.dhHint },
              { value: "urdf", label: words.urdf, hint: words.urdfHintShort },
            ]}
          />
          {format === "catalogue" ? (
            <ArmChooser chosen={arm} choose={setArm} />
          ) : format === "dh" ? (
            <DhEditor table={dh} change={setDh} />
          ) : (
            <UrdfEditor given={urdf} change={setUrdf} />
          )}
        </section>
        <section class="card sticky">
          <h2>{words.draw}</h2>
          {source ? <Arm source={source} start={null} /> : <p class="stage blank">{text.start.armHere}</p>}
          <div class="go">
            <ActionButton
              look="primary big"
              action={save}
              disabled={!document || (!name.trim() && format !== "catalogue")}
              going={words.saving}
            >
              {words.save}
            </ActionButton>
            {format === "catalogue" && arm && (
              <Button
                onClick={() => {
                  setDh({ model: { ...arm.model }, map: arm.joint_map && { ...arm.joint_map } });
                  setName(name || arm.name);
                  setFormat("dh");
                }}
              >
                {words.edit}
              </Button>
            )}
          </div>
          {format === "catalogue" && arm && <ArmFacts arm={arm} />}
        </section>
      </div>
    </>
  );
}

interface UrdfText {
  urdf: string;
  base: string;
  flange: string;
}

interface Links {
  all: string[];
  root: string;
  leaf: string;
}

/** The links of a document; null where it is no XML. The service vets it, this only fills two lists. */
function linksOf(urdf: string): Links | null {
  const document = new DOMParser().parseFromString(urdf, "text/xml");
  if (document.querySelector("parsererror")) return null;
  const names = (selector: string, attribute: string) =>
    [...document.querySelectorAll(selector)].map((e) => e.getAttribute(attribute) ?? "");
  const all = names("robot > link", "name");
  const [parents, children] = [new Set(names("joint > parent", "link")), new Set(names("joint > child", "link"))];
  const leaves = all.filter((link) => !parents.has(link));
  return {
    all,
    root: all.find((link) => !children.has(link)) ?? "",
    leaf: leaves.find((link) => /flange|tool0|tcp/i.test(link)) ?? leaves.at(-1) ?? "",
  };
}

function UrdfEditor({ given, change }: { given: UrdfText; change: (given: UrdfText) => void }) {
  const words = later.robots;
  const links = useMemo(() => (given.urdf ? linksOf(given.urdf) : null), [given.urdf]);
  const take = (urdf: string) => {
    const found = urdf ? linksOf(urdf) : null;
    change({ urdf, base: found?.root ?? "", flange: found?.leaf ?? "" });
  };
  const options = (links?.all ?? []).map((name) => ({ value: name, label: name }));
  return (
    <>
      <DropZone
        compact
        title=""
        hint=""
        button={words.urdfChoose}
        accept=".urdf,.xml,application/xml,text/xml"
        take={(file) => void file.text().then(take)}
      />
      <label class="field">
        <span>{words.urdfPaste}</span>
        <textarea
          rows={10}
          spellcheck={false}
          value={given.urdf}
          onInput={(event) => take(event.currentTarget.value)}
        />
        <small>{words.urdfHint}</small>
      </label>
      {given.urdf && !links && <p class="note warn">{words.urdfBad}</p>}
      {links && (
        <div class="row">
          <Select
            label={words.base}
            value={given.base}
            change={(base) => change({ ...given, base })}
            options={options}
          />
          <Select
            label={words.flange}
            value={given.flange}
            change={(flange) => change({ ...given, flange })}
            options={options}
          />
        </div>
      )}
    </>
  );
}
