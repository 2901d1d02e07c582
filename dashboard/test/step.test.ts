import { describe, expect, it } from "vitest";
import * as step from "../src/features/gearbox/step";

const planned = ["s01", "s02"].map((label) => ({ label, joints: [Math.PI, 0.25] }));
const joints = ["joint_2", "joint_3"];
const at = (side: step.Side, state: step.StepState, joint = "joint_2"): step.Place => ({
  posture: "s01",
  joint,
  side,
  state,
});

/** What one types who reads both angles of some places. */
const typedAt = (...places: step.Place[]): step.Typed =>
  Object.fromEntries(
    places.flatMap((place) => [
      [step.keyOf(place, "motor"), "-19,9999"],
      [step.keyOf(place, "link"), place.state === "loaded" ? "-19.9" : "\u221220"],
    ]),
  );

const observed = (typed: step.Typed) => step.observationsOf(typed, planned, joints, ["revolute", "prismatic"]);

describe("a weight step that is typed", () => {
  it("has only readings with all four angles, in degrees and metres", () => {
    const half = typedAt(at("+", "unloaded"), at("-", "unloaded"), at("-", "loaded", "joint_3"));
    expect(observed(half)).toEqual([]);
    const whole = { ...half, ...typedAt(at("-", "loaded")) };
    expect(observed(whole)).toEqual([
      {
        label: "s01",
        joints: [180, 0.25],
        encoder_readings: [
          {
            joint: "joint_2",
            approach: "-",
            unloaded: { motor: -19.9999, link: -20 },
            loaded: { motor: -19.9999, link: -19.9 },
          },
        ],
      },
    ]);
  });

  it("names each place that lacks an angle, or has one that is no number", () => {
    const places = step.placesOf("s01", joints, "loaded");
    const typed = typedAt(...places);
    expect(step.missingOf(typed, places)).toEqual([]);
    typed[step.keyOf(at("-", "loaded"), "link")] = "20..1";
    delete typed[step.keyOf(at("+", "loaded", "joint_3"), "motor")];
    expect(step.missingOf(typed, places)).toEqual([at("+", "loaded", "joint_3"), at("-", "loaded")]);
  });

  it("counts the postures of the joint that is read in most, not its sides", () => {
    const both = typedAt(at("+", "unloaded"), at("+", "loaded"), at("-", "unloaded"), at("-", "loaded"));
    expect(step.mostRead(observed(both))).toBe(1);
    expect(step.mostRead([])).toBe(0);
  });
});
