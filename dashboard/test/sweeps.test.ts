import { readFileSync } from "node:fs";
import { describe, expect, it } from "vitest";
import { readingsOf } from "../src/lib/campaign";

const EXAMPLE = readFileSync(new URL("../../examples/sweeps.json", import.meta.url), "utf8");

describe("readings for a geometry", () => {
  it("keeps the nominal model apart from what is posted", () => {
    const read = readingsOf(EXAMPLE);
    expect(read?.robot?.name).toBe("simulated 6R");
    expect(Object.keys(read?.request ?? {})).toEqual(["name", "units", "noise", "sweeps"]);
  });

  it("says what turns, how far, and which targets are read", () => {
    const facts = readingsOf(EXAMPLE)?.facts;
    expect(facts).toMatchObject({ name: "cell 3", units: "m, rad", poses: null, targets: ["P10", "P11", "P12"] });
    expect(facts?.sweeps.map(({ joint, positions }) => [joint, positions])).toEqual(
      [1, 2, 3, 4, 5, 6].map((j) => [`joint_${j}`, 10]),
    );
    expect(facts?.sweeps.map(({ arc }) => Math.round(arc ?? 0))).toEqual([100, 70, 80, 160, 140, 300]);
  });

  it("takes poses, with the robot that they name", () => {
    const read = readingsOf(JSON.stringify({ robot_id: "r1", poses: [{ joints: [1], targets: { A: [1, 2, 3] } }] }));
    expect(read).toMatchObject({ robotId: "r1", facts: { poses: 1, sweeps: [], targets: ["A"] } });
  });

  it.each(["", "[]", "{}", '{"observations": []}', '{"sweeps": 3}'])("takes nothing from %j", (content) =>
    expect(readingsOf(content)).toBeNull(),
  );

  it("says nothing where the file is wrong, and never throws", () => {
    const wrong = { sweeps: [null, { joint: 3 }, { joint: "a", observations: [{}, { joints: "x", targets: [] }] }] };
    expect(readingsOf(JSON.stringify(wrong))?.facts.sweeps).toMatchObject([
      { joint: "3", positions: 0, arc: null },
      { joint: "a", positions: 2, arc: null },
    ]);
  });
});
