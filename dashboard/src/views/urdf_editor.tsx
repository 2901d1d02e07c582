import { Select } from "../components/fields";
/** A URDF pasted or uploaded, and which of its links are base and flange. */
import { useMemo } from "preact/hooks";

import { DropZone } from "../components/drop";
import { text } from "../i18n";

export interface UrdfText {
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

export function UrdfEditor({ given, change }: { given: UrdfText; change: (given: UrdfText) => void }) {
  const words = text.robots;
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
