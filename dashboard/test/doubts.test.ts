import { describe, expect, it } from "vitest";
import type { Posture } from "../src/api/types";
import { type Checked, checkedOf, doubtsOf } from "../src/features/gearbox/doubts";
import * as step from "../src/features/gearbox/step";

const NAMES = ["joint_1", "joint_2"];
const COMPLIANCE = 3e-7; // rad/(N·m)
const LOST = 15e-6; // rad

/** Twelve postures whose torques about joint 2 vary. */
const POSTURES: Checked[] = Array.from({ length: 12 }, (_, i) => ({
  label: `p${i + 1}`,
  angles: [0, -80 + 11 * i],
  torques: [0, 900 * Math.cos(i) + 300],
}));

/** Noise of an angle [rad], the same at each run. */
const noise = (seed: number): number => 5e-6 * Math.sin(12.9898 * seed * seed);

type Angles = { motor: number; link: number };
type Mistake = (angles: Angles, place: step.Place, index: number) => Angles;

/** What one types who reads some postures in both states, with a mistake. */
function typed(postures: Checked[], mistake: Mistake = (angles) => angles): step.Typed {
  const all: step.Typed = {};
  let seed = 0;
  postures.forEach((posture, index) => {
    for (const state of step.STATES)
      for (const place of step.placesOf(posture.label, ["joint_2"], state)) {
        seed += 1;
        const byLoad = state === "loaded" ? COMPLIANCE * (posture.torques?.[1] ?? 0) : 0;
        const lost = place.side === "+" ? 0.5 * LOST : -0.5 * LOST;
        const motor = posture.angles[1] ?? 0;
        const link = motor - (180 / Math.PI) * (byLoad + lost + 40e-6 + noise(seed));
        const read = mistake({ motor, link }, place, index);
        all[step.keyOf(place, "motor")] = read.motor.toFixed(6);
        all[step.keyOf(place, "link")] = read.link.toFixed(6);
      }
  });
  return all;
}

const kinds = (all: step.Typed, postures = POSTURES): string[] =>
  doubtsOf(all, postures, NAMES, ["joint_2"]).map(({ kind }) => kind);

describe("a weight step while it is read", () => {
  it("has no doubt without a mistake, however many postures are read", () => {
    for (let read = 0; read <= POSTURES.length; read += 1) expect(kinds(typed(POSTURES.slice(0, read)))).toEqual([]);
  });

  it.each<[string, string, Mistake]>([
    ["angles in radians", "unit", ({ motor, link }) => ({ motor: motor * 0.01745, link: link * 0.01745 })],
    ["a motor's angle before the gear", "unit", ({ motor, link }) => ({ motor: 160 * motor, link })],
    ["a link's angle of the other sign", "twist", ({ motor, link }) => ({ motor, link: -link })],
    ["both signs reversed", "against", ({ motor, link }) => ({ motor: -motor, link: -link })],
    [
      "the states exchanged",
      "against",
      ({ motor, link }, { state }) => ({ motor, link: link + (state === "loaded" ? 2 : 0) * (motor - link) }),
    ],
    [
      "an encoder referenced anew",
      "anew",
      ({ motor, link }, { state }) => ({ motor, link: link + (state === "loaded" ? 0.06 : 0) }),
    ],
    ["sides exchanged", "sides", ({ motor, link }, { side }) => ({ motor, link: link + (side === "+" ? 0.002 : 0) })],
  ])("doubts %s", (_, kind, mistake) => {
    expect(kinds(typed(POSTURES.slice(0, 6), mistake))).toContain(kind);
  });

  it("names the posture in which a digit is wrong, or the load did not hang, or the arm stood elsewhere", () => {
    const at =
      (index: number, mistake: Mistake): Mistake =>
      (angles, place, of) =>
        of === index ? mistake(angles, place, of) : angles;
    const wrongDigit = at(2, ({ motor, link }) => ({ motor, link: link + 2 }));
    const noLoad = at(5, ({ motor, link }, { state, posture }) => {
      const torque = POSTURES.find(({ label }) => label === posture)?.torques?.[1] ?? 0;
      return { motor, link: link + (state === "loaded" ? (180 / Math.PI) * COMPLIANCE * torque : 0) };
    });
    const elsewhere = at(1, ({ motor, link }) => ({ motor: motor + 1, link: link + 1 }));
    for (const [mistake, kind, label] of [
      [wrongDigit, "twist", "p3"],
      [noLoad, "off", "p6"],
      [elsewhere, "posture", "p2"],
    ] as const)
      expect(doubtsOf(typed(POSTURES, mistake), POSTURES, NAMES, ["joint_2"])).toMatchObject([
        { kind, postures: [label] },
      ]);
  });

  it("judges units and signs before the axes of the arm are known", () => {
    const postures = POSTURES.map((posture) => ({ ...posture, torques: null }));
    const mistaken = typed(POSTURES, ({ motor, link }) => ({ motor, link: -link }));
    expect(kinds(mistaken, postures)).toContain("twist");
    expect(kinds(typed(POSTURES), postures)).toEqual([]);
  });

  it("computes the torque with which a motor holds the load", () => {
    const arm = {
      joint_names: ["joint_1"],
      joint_origins: [[0, 0, 1]],
      joint_axes: [[0, 1, 0]],
      joint_kinds: ["revolute"],
      flange_origin: [2, 0, 1],
      flange_axes: [
        [1, 0, 0],
        [0, 1, 0],
        [0, 0, 1],
      ],
    } as unknown as Posture;
    const planned = { label: "p1", joints: [0], force: [0, 0, -100] as [number, number, number] };
    const { torques } = checkedOf(planned as Parameters<typeof checkedOf>[0], arm, [0.5, 0, 0]);
    // The weight turns the joint about +y by 250 N·m; the motor holds against it.
    expect(torques).toEqual([-250]);
  });
});
