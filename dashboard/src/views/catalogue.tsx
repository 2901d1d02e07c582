/** Choosing a nominal arm of the catalogue, and what is known of it. */
import { useMemo, useState } from "preact/hooks";
import { api } from "../api/client";
import type { Catalogue, NominalArm } from "../api/types";
import { Choice, Facts, Name, Show } from "../components/basics";
import { TextField } from "../components/fields";
import { fixed } from "../lib/format";
import { cached, useLoad } from "../state/load";
import { text } from "../i18n";
import { later } from "../i18n/later";
import { JointMapTable, RowsTable } from "./robot_tables";

/** The catalogue is the same as long as the service runs. */
export const useCatalogue = () => useLoad(() => cached("catalogue", api.catalogue), []);

/** The arms whose names have all the words; blanks and marks between letters do not count. */
export function found(catalogue: Catalogue, words: string): NominalArm[] {
  const asked = words.split(/\s+/).map(bare);
  return catalogue.arms.filter((arm) => asked.every((word) => bare(arm.name).includes(word)));
}

const bare = (name: string): string => name.toLowerCase().replace(/[^\p{L}\p{N}]+/gu, "");

export function ArmChooser({ chosen, choose }: { chosen: NominalArm | null; choose: (arm: NominalArm) => void }) {
  const words = later.robots;
  const catalogue = useCatalogue();
  const [typed, setTyped] = useState("");
  return (
    <>
      <TextField
        type="search"
        label={words.search}
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
  `${fixed(arm.reach * 1e3, 0)} ${text.units.mm} (${later.robots.reachOf[arm.reach_of]})`;

export function ArmFacts({ arm }: { arm: NominalArm }) {
  const words = later.robots;
  const catalogue = useCatalogue();
  const presets = catalogue.state === "ready" ? catalogue.value.joint_maps : [];
  const preset = useMemo(() => presets.find((each) => each.id === arm.joint_map_preset), [presets, arm]);
  return (
    <>
      <p class="note warn">{words.nominalNote}</p>
      <RowsTable model={arm.model} />
      <Facts
        facts={[
          { label: words.reach, value: reachOf(arm) },
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
