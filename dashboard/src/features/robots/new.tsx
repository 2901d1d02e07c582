/** Adding a robot: an arm of the catalogue, a DH table or a URDF, drawn at once, stored when it looks right. */
import { useMemo, useState } from "preact/hooks";
import { api } from "../../api/calls";
import { queries } from "../../api/queries";
import type { Catalogue, NominalArm, JointMap, RobotDocument } from "../../api/types";
import { Choice, Facts, Name, Show, ActionButton, Button, Title } from "../../components/basics";
import { TextField, Select } from "../../components/fields";
import { fixed } from "../../lib/format";
import { keepStoredLast } from "../../state/choices";
import { ask, useQuery } from "../../state/query";
import { text } from "../../words";
import { JointMapTable, JointsTable } from "./view";
import { SchemaFields, type Terms, DropZone } from "../../components/schema_form";
import { type Fields, unreadIn, contentKey } from "../../lib/json";
import { Arm } from "../../scene/view";
import { useAction, link } from "../../state/action";
import { begunFiles } from "../readings/begun";
import { forgetTyped, useTypedValue } from "../../state/session";
import { robotWords } from "./words";

const words = robotWords;
const NONE: Catalogue["joint_maps"] = [];

/** The arms whose names have all the words; blanks and marks between letters do not count. */
export function found(catalogue: Catalogue, words: string): NominalArm[] {
  const asked = words.split(/\s+/).map(bare);
  return catalogue.arms.filter((arm) => asked.every((word) => bare(arm.name).includes(word)));
}

const bare = (name: string): string => name.toLowerCase().replace(/[^\p{L}\p{N}]+/gu, "");

export function ArmChooser({ chosen, choose }: { chosen: NominalArm | null; choose: (arm: NominalArm) => void }) {
  const catalogue = useQuery(queries.catalogue);
  const [typed, setTyped] = useState("");
  return (
    <>
      <TextField
        type="search"
        label={text.list.search}
        placeholder={words.searchPlaceholder}
        value={typed}
        change={setTyped}
      />
      <Show of={catalogue}>
        {(known) => {
          const arms = found(known, typed);
          if (arms.length === 0) return <p class="note warn">{words.noArm}</p>;
          return (
            <Choice
              label={words.arms}
              look="choice cards arms"
              value={chosen?.name ?? ""}
              change={(name) => choose(arms.find((arm) => arm.name === name) as NominalArm)}
              options={arms.map((arm) => ({
                value: arm.name,
                label: arm.name,
                hint: `${words.reach} ${reachOf(arm)}`,
              }))}
            />
          );
        }}
      </Show>
    </>
  );
}

const reachOf = (arm: NominalArm): string =>
  `${fixed(arm.reach * 1e3, 0)} ${text.units.mm} (${words.reachOf[arm.reach_of]})`;

export function ArmFacts({ arm }: { arm: NominalArm }) {
  const catalogue = useQuery(queries.catalogue);
  const presets = catalogue.data?.joint_maps ?? NONE;
  const preset = useMemo(() => presets.find((each) => each.id === arm.joint_map_preset), [presets, arm]);
  return (
    <>
      <p class="note warn">{words.nominalNote}</p>
      <JointsTable
        joints={arm.model.rows.map((row) => ({ name: "", lower: null, upper: null, speed: null, ...row }))}
        rows={arm.model.rows}
      />
      <Facts
        facts={[
          { label: words.reach, value: reachOf(arm) },
          arm.payload != null && { label: words.payload, value: `${arm.payload} kg` },
          { label: words.origin, value: arm.base },
          { label: words.map, value: preset ? `${preset.name}. ${preset.note}` : words.identity },
          {
            label: words.sources,
            value: arm.sources.map((source) => (
              <p>
                <Name>{source}</Name>
              </p>
            )),
          },
        ]}
      />
      {arm.joint_map && <JointMapTable map={arm.joint_map} kinds={arm.model.rows.map(({ kind }) => kind)} />}
    </>
  );
}

/** Model and joint map as they are typed, in SI; a map of null is none. */
export interface DhTable {
  model: Fields;
  map: Fields | null;
}

const EMPTY = { kind: "revolute" };
const AXES = 6;

/** An empty table of a six-axis arm. */
export const newDh = (): DhTable => ({
  model: { format: "dh", convention: "modified", rows: Array.from({ length: AXES }, () => EMPTY) },
  map: null,
});

const rowsOf = ({ model }: DhTable): Fields[] => model["rows"] as Fields[];

/** The robot of a table, or null while something is no number, or no length is given. A blank cell is 0. */
export function documentOf(name: string, table: DhTable): RobotDocument | null {
  const rows = rowsOf(table).map((row) => ({ ...row, ...filled(row) }));
  if (unreadIn(table) !== null || rows.every(({ a, d }) => a === 0 && d === 0)) return null;
  return { name, model: { ...table.model, rows }, joint_map: table.map } as unknown as RobotDocument;
}

const filled = ({ a, alpha, d, theta }: Fields) => ({ a: a ?? 0, alpha: alpha ?? 0, d: d ?? 0, theta: theta ?? 0 });

/** A joint map as large as the table: joints stand for themselves. */
const identity = (count: number): Fields => ({
  matrix: Array.from({ length: count }, (_, i) => Array.from({ length: count }, (_, j) => (i === j ? 1 : 0))),
  offset: Array.from({ length: count }, () => 0),
});

export function DhEditor({ table, change }: { table: DhTable; change: (table: DhTable) => void }) {
  const rows = rowsOf(table);
  const slides = rows.some(({ kind }) => kind === "prismatic");
  const terms: Terms = {
    labels: {
      rows: words.rowsTitle,
      ...Object.fromEntries(Object.entries(words.column).map(([name, shown]) => [`rows.${name}`, shown])),
    },
    seeds: { rows: EMPTY },
    units: slides ? { offset: ["rad, m", 1] } : {},
  };
  return (
    <>
      <SchemaFields
        of="DhModel"
        show={["convention", "rows"]}
        value={table.model}
        change={(model) => change({ ...table, model })}
        terms={terms}
      />
      <details
        open={table.map !== null}
        onToggle={({ currentTarget: { open } }) => {
          if (open !== (table.map !== null)) change({ ...table, map: open ? identity(rows.length) : null });
        }}
      >
        <summary>{words.jointMap}</summary>
        <p class="soft">{words.jointMapHint}</p>
        {table.map && (
          <>
            <Presets map={table.map} count={rows.length} change={(map) => change({ ...table, map })} />
            <SchemaFields
              of="JointMap"
              show={["matrix", "offset"]}
              value={table.map}
              change={(map) => change({ ...table, map })}
              terms={terms}
            />
          </>
        )}
      </details>
    </>
  );
}

/** Joint maps that many controllers share; they fit tables of as many rows. */
function Presets({ map, count, change }: { map: Fields; count: number; change: (map: Fields) => void }) {
  const catalogue = useQuery(queries.catalogue);
  const presets = catalogue.data?.joint_maps ?? NONE;
  const fitting = presets.filter((preset) => preset.joint_map.matrix.length === count);
  const same = (one: JointMap) => JSON.stringify(one.matrix) === JSON.stringify(map["matrix"]);
  const current = fitting.find(({ joint_map: one }) => same(one) && (map["offset"] as number[]).every((o) => o === 0));
  if (fitting.length === 0) return null;
  return (
    <Select
      label={words.preset}
      value={current?.id ?? ""}
      change={(id) => {
        const chosen = fitting.find((preset) => preset.id === id);
        if (chosen) change({ ...chosen.joint_map });
      }}
      options={[{ value: "", label: words.presetNone }, ...fitting.map(({ id, name }) => ({ value: id, label: name }))]}
      {...(current ? { help: current.note } : {})}
    />
  );
}

type Format = "catalogue" | "dh" | "urdf";

export function RobotNewView() {
  const [name, setName] = useTypedValue("robot/name", "");
  const [format, setFormat] = useTypedValue<Format>("robot/format", "catalogue");
  const [arm, setArm] = useTypedValue<NominalArm | null>("robot/arm", null);
  const [dh, setDh] = useTypedValue<DhTable>("robot/dh", newDh());
  const [urdf, setUrdf] = useTypedValue<UrdfText>("robot/urdf", { urdf: "", base: "", flange: "" });
  const [stated, setStated] = useTypedValue<Fields>("robot/stated", {});
  const document = useMemo<RobotDocument | null>(() => {
    if (format === "catalogue") {
      return arm && { name: name.trim() || arm.name, model: arm.model, joint_map: arm.joint_map };
    }
    if (unreadIn(stated) !== null) return null;
    if (format === "dh") {
      const made = documentOf(name.trim() || words.namePlaceholder, dh);
      return made && { ...made, ...stated };
    }
    if (!urdf.urdf || !urdf.base || !urdf.flange) return null;
    return {
      name: name.trim() || words.namePlaceholder,
      model: { format: "urdf", ...urdf },
      joint_map: null,
      ...stated,
    };
  }, [name, format, arm, dh, urdf, stated]);
  const source = document && { robot: { ...document, name: "drawn" } };
  const named = name.trim() !== "" || format === "catalogue";
  const save = useAction(async () => {
    if (!document) return;
    const robot =
      format === "catalogue" && arm
        ? { name: document.name, model: { format: "catalogue" as const, arm: arm.name } }
        : { ...document, name: name.trim() };
    const { id } = await api.robots.add(robot, contentKey("robot", robot));
    forgetTyped("robot/");
    keepStoredLast(id);
    return (await ask(begunFiles)) ? link([], { robot: id }) : link(["robots", id]);
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
          {format !== "catalogue" && (
            <SchemaFields of="RobotDocument" show={["payload"]} value={stated} change={setStated} />
          )}
        </section>
        <section class="card sticky">
          <h2>{words.draw}</h2>
          <Arm source={source} start={null} />
          <div class="go">
            <ActionButton look="primary big" action={save} disabled={!document || !named} going={words.saving}>
              {words.save}
            </ActionButton>
            {document && !named && <span class="soft">{words.nameFirst}</span>}
            {format === "catalogue" && arm && (
              <Button
                onClick={() => {
                  setDh({ model: { ...arm.model }, map: arm.joint_map && { ...arm.joint_map } });
                  setName(name || arm.name);
                  setStated(arm.payload == null ? {} : { payload: arm.payload });
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

/** The links of a document; null where it is no XML. The service vets it, this only fills two lists. */
function linksOf(urdf: string) {
  const document = new DOMParser().parseFromString(urdf, "text/xml");
  if (document.querySelector("parsererror")) return null;
  const names = (selector: string, attribute: string) =>
    [...document.querySelectorAll(selector)].map((e) => e.getAttribute(attribute) ?? "");
  const all = names("robot > link", "name");
  const [parents, children] = [new Set(names("joint > parent", "link")), new Set(names("joint > child", "link"))];
  const leaves = all.filter((link) => !parents.has(link));
  const named = (name: RegExp) => all.find((link) => name.test(link));
  return {
    all,
    root: all.find((link) => !children.has(link)) ?? "",
    // Behind the flange a gripper may follow, whose fingers are leaves: of several leaves, the user chooses.
    leaf: named(/(^|_)tool0$/i) ?? named(/(^|_)flange$/i) ?? (leaves.length === 1 ? (leaves[0] ?? "") : ""),
  };
}

function UrdfEditor({ given, change }: { given: UrdfText; change: (given: UrdfText) => void }) {
  const links = useMemo(() => (given.urdf ? linksOf(given.urdf) : null), [given.urdf]);
  const take = (urdf: string) => {
    const found = urdf ? linksOf(urdf) : null;
    change({ urdf, base: found?.root ?? "", flange: found?.leaf ?? "" });
  };
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
      <TextField label={words.urdfPaste} help={words.urdfHint} lines={10} value={given.urdf} change={take} />
      {given.urdf && !links && <p class="note warn">{words.urdfBad}</p>}
      {links && (
        <div class="row">
          {(["base", "flange"] as const).map((end) => (
            <Select
              label={words[end]}
              value={given[end]}
              change={(chosen) => change({ ...given, [end]: chosen })}
              options={[
                ...(given[end] ? [] : [{ value: "", label: words.linkChoose }]),
                ...links.all.map((name) => ({ value: name, label: name })),
              ]}
            />
          ))}
        </div>
      )}
    </>
  );
}
