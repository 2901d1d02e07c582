// @vitest-environment happy-dom
import { describe, expect, it, vi } from "vitest";
import { QuestionDialog } from "../../src/components/question";
import { api } from "../../src/api/calls";
import type { Catalogue, MeasurementSet, NominalArm, RunSummary } from "../../src/api/types";
import { StoredActions } from "../../src/components/list";
import { ArmChooser, ArmFacts, found } from "../../src/features/robots/new";
import { newestOf, SetMetadata } from "../../src/features/robots/view";
import { drawn, press, settled } from "./drawn";

const row = { a: 0.35, alpha: -Math.PI / 2, d: 0, theta: 0, lower: -Math.PI, upper: null, kind: "revolute" } as const;
const arm = (name: string): NominalArm => ({
  name,
  maker: name.split(" ")[0] ?? "",
  model: { format: "dh", convention: "modified", length_unit: "m", angle_unit: "rad", rows: [row] },
  joint_map: { matrix: [[-1]], offset: [0] },
  joint_map_preset: "kuka",
  base: "on axis 1, at the floor",
  reach: 2.696,
  reach_of: "wrist_centre",
  payload: 210,
  sources: ["a data sheet"],
});
const catalogue: Catalogue = {
  arms: [arm("KUKA KR 210 R2700 extra"), arm("FANUC R-2000iC/165F")],
  joint_maps: [
    { id: "kuka", name: "A1 turns the other way", note: "Clockwise.", joint_map: { matrix: [[-1]], offset: [0] } },
  ],
};

describe("the catalogue", () => {
  it("finds arms as people type their names", () => {
    const names = (words: string) => found(catalogue, words).map(({ name }) => name);
    expect(names("kr210")).toEqual(["KUKA KR 210 R2700 extra"]);
    expect(names("r2000ic 165")).toEqual(["FANUC R-2000iC/165F"]);
    expect(names("")).toHaveLength(2);
    expect(names("irb")).toEqual([]);
  });

  it("is chosen from, and says what is nominal, where R0 is, and the sources", async () => {
    vi.spyOn(api, "catalogue").mockResolvedValue(catalogue);
    const choose = vi.fn();
    const root = await drawn(<ArmChooser chosen={null} choose={choose} />);
    await settled(() => {});
    const radio = root.querySelector<HTMLInputElement>("input[type=radio]");
    await settled(() => radio?.click());
    expect(choose).toHaveBeenCalledWith(catalogue.arms[0]);
    const facts = await drawn(<ArmFacts arm={arm("KUKA KR 210 R2700 extra")} />);
    await settled(() => {});
    for (const said of [
      "Nominal values",
      "2696 mm",
      "210 kg",
      "wrist centre",
      "at the floor",
      "A1 turns",
      "a data sheet",
      "350",
    ])
      expect(facts.textContent).toContain(said);
  });
});

describe("names", () => {
  it("change, and blank or unchanged names do not", async () => {
    const change = vi.fn(async () => {});
    const root = await drawn(
      <>
        <StoredActions
          of={{ id: "r", name: "cell 3" }}
          api={{ change, delete: change, restore: change }}
          list="#/robots"
        />
        <QuestionDialog />
      </>,
    );
    const rename = async (typed: string | null) => {
      await press(root, "Rename");
      const field = root.querySelector<HTMLInputElement>("dialog input");
      await settled(() => {
        if (!field) throw new Error("no field");
        field.value = typed ?? field.value;
        field.dispatchEvent(new Event("input"));
      });
      if (typed === null) await press(root, "Cancel");
      else await settled(() => root.querySelector("form")?.requestSubmit());
    };
    for (const typed of [null, " ", "cell 3"]) await rename(typed);
    expect(change).not.toHaveBeenCalled();
    await rename(" cell 4 ");
    await settled(() => {});
    expect(change).toHaveBeenLastCalledWith("r", { name: "cell 4" });
    expect(change).toHaveBeenCalledTimes(1);
  });
});

describe("what is noted about a set", () => {
  it("is shown, changed, and sent with null where nothing is", async () => {
    const set = { id: "s1", operator: "M. Keller", notes: "one\ntwo" } as MeasurementSet;
    const send = vi.spyOn(api.sets, "change").mockResolvedValue({} as never);
    const root = await drawn(<SetMetadata set={set} />);
    expect(root.textContent).toContain("M. Keller");
    await press(root, "Edit");
    const serial = root.querySelector<HTMLInputElement>("input[placeholder='F-211034']");
    await settled(() => {
      if (!serial) throw new Error("no field");
      serial.value = "F-2";
      serial.dispatchEvent(new Event("input", { bubbles: true }));
    });
    await press(root, "Save");
    await settled(() => {});
    expect(send).toHaveBeenCalledWith("s1", {
      measured_at: null,
      serial_number: "F-2",
      item_condition: null,
      operator: "M. Keller",
      instrument: null,
      conditions: null,
      notes: "one\ntwo",
    });
  });
});

describe("robots of one kind side by side", () => {
  const run = (id: string, robot_id: string, set: string, created_at: string, variant_of: string | null = null) =>
    ({ id, robot_id, measurement_set_id: set, created_at, variant_of }) as RunSummary;
  it("shows the newest run of each robot and serial number, by the time of measurement", () => {
    const sets = new Map([
      ["a1", { serial_number: "A", measured_at: "2026-11-01T00:00:00Z" }],
      ["a2", { serial_number: "A", measured_at: "2026-11-05T00:00:00Z" }],
      ["b1", { serial_number: "B", measured_at: null }],
    ]);
    const runs = [
      run("later but older", "r1", "a1", "2026-11-20T00:00:00Z"),
      run("newest of A", "r1", "a2", "2026-11-06T00:00:00Z"),
      run("of B", "r1", "b1", "2026-11-03T00:00:00Z"),
      run("varied", "r1", "b1", "2026-11-04T00:00:00Z", "of B"),
      run("another robot", "r2", "x", "2026-11-02T00:00:00Z"),
    ];
    expect(newestOf(runs, sets).map(({ id }) => id)).toEqual(["newest of A", "of B", "another robot"]);
  });
});
