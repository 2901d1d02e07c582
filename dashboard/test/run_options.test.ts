import { describe, expect, it } from "vitest";
import type { Problem, RunOptions } from "../src/api/types";
import { elsewhere, faultsAt } from "../src/lib/faults";
import { NOISE_AS_READ, noiseOf, statesNoise } from "../src/lib/noise";
import { initialOptions, optionsOf, requestOf } from "../src/lib/run_options";

describe("request of a run", () => {
  it("does not send defaults that were left alone", () => {
    expect(requestOf("s", initialOptions)).toEqual({ measurement_set_id: "s" });
  });

  it("sends bounds, priors and orders of the joints where something was typed, in N·m/rad", () => {
    const options = {
      ...initialOptions,
      bounds: { joint_2: ["1.5", ""], joint_3: ["", " "] } as Record<string, [string, string]>,
      priors: { joint_5: ["0,4", "x"] } as Record<string, [string, string]>,
      orders: [["joint_2", "joint_4"] as [string, string], ["", ""] as [string, string]],
    };
    expect(requestOf("s", options, 1e6)).toEqual({
      measurement_set_id: "s",
      stiffness_bounds: { joint_2: [1.5e6, null] },
      priors: { joint_5: { stiffness: 4e5, standard_uncertainty: "x" } },
      stiffness_order: [["joint_2", "joint_4"]],
    });
  });

  it("takes the own weight for the load, and keeps what a file says of it", () => {
    const weighed = { measurement_set_id: "s", weight: { estimate_gravity: false } };
    expect(requestOf("s", { ...initialOptions, ownWeight: true })).toEqual(weighed);
    expect(requestOf("s", optionsOf({ weight: {} } as Partial<RunOptions>))).toEqual(weighed);
    const stated = { weight: { gravity: [0, 0, 9.8] } } as unknown as Partial<RunOptions>;
    expect(requestOf("s", optionsOf(stated))).toEqual({ measurement_set_id: "s", ...stated });
  });

  it("leaves out what another choice has no use for", () => {
    const typed = {
      ...initialOptions,
      loss: "huber" as const,
      huberThreshold: "2",
      characteristicLength: "1500",
      linkPenalty: "0.1",
      links: ["joint_2"],
      folds: "4",
    };
    expect(requestOf("s", { ...typed, elasticity: "joints" })).toEqual({
      measurement_set_id: "s",
      elasticity: "joints",
      loss: "huber",
      huber_threshold: 2,
    });
    expect(requestOf("s", typed)).toEqual({
      measurement_set_id: "s",
      loss: "huber",
      huber_threshold: 2,
      links: ["joint_2"],
      cross_validation: { folds: 4 },
    });
  });
});

describe("run of a campaign file", () => {
  // every field of the message, or tsc refuses it
  const run: Required<RunOptions> = {
    method: "complete_pose",
    weighting: "characteristic_length",
    characteristic_length: 0.75,
    positive: false,
    stiffness_bounds: { joint_2: [1.5e6, null] },
    loss: "huber",
    huber_threshold: 2.5,
    complementary_stiffness: "neglected",
    priors: { joint_5: { stiffness: 4e5, standard_uncertainty: 3.3e4 } },
    causes: [{ name: "shift", first: "P9" }],
    stiffness_order: [["joint_2", "joint_4"]],
    elasticity: "joints_and_links",
    links: ["joint_2", "joint_3"],
    link_penalty: 0.03,
    cross_validation: { folds: 4, draws: 2, seed: 7, rule: "one_standard_error" },
    resampling: { size: 8, repetitions: 300, seed: 3, replacement: true },
    confidence: 0.9,
    weight: { bodies: "as stored" } as unknown as RunOptions["weight"],
  };

  it("goes into the request whole, in any unit of the page", () => {
    for (const unit of [1, 1e6, 60 / (Math.PI / 180)]) {
      expect(requestOf("s", optionsOf(run, unit), unit)).toEqual({ measurement_set_id: "s", ...run });
    }
  });

  it("sends what differs from the defaults", () => {
    expect(requestOf("s", optionsOf({ loss: "automatic", method: "partial_pose", positive: true }))).toEqual({
      measurement_set_id: "s",
    });
  });

  it("sends what it cannot show as it stands, for the service to judge", () => {
    const odd = { stiffness_order: 5, priors: { joint_1: null }, colour: "red" } as unknown as RunOptions;
    expect(requestOf("s", optionsOf(odd))).toEqual({ measurement_set_id: "s", ...odd });
    expect(requestOf("s", optionsOf({ links: ["joint_2"] }))).toEqual({ measurement_set_id: "s", links: ["joint_2"] });
    expect(requestOf("s", optionsOf({ loss: "absolute" }))).toEqual({ measurement_set_id: "s", loss: "absolute" });
  });
});

describe("noise", () => {
  const units = { length: "mm", angle: "deg", force: "N", moment: null } as const;

  it("is that of the readings until something is stated", () => {
    expect(statesNoise(NOISE_AS_READ)).toBe(false);
    expect(noiseOf(NOISE_AS_READ, null, units)).toBeNull();
  });

  it("goes in the units of the set; what is not stated stays", () => {
    const before = {
      sigma: 0.02,
      instrument: null,
      encoder_sigma: 1e-4,
      force: null,
      load_point: null,
      target_places: 0.5,
      axes: null,
      refuted: false,
    };
    expect(noiseOf({ ...NOISE_AS_READ, forceScale: "0.5" }, before, units)).toEqual({
      sigma: 0.02,
      encoder_sigma: 1e-4,
      force: { scale: 0.005, direction: 0 },
      target_places: 0.5,
    });
    const alone = { ...before, encoder_sigma: null, target_places: null };
    expect(noiseOf({ ...NOISE_AS_READ, kind: "residuals" }, alone, units)).toBeNull();
    const refuted = { ...alone, refuted: true };
    expect(noiseOf(NOISE_AS_READ, refuted, units)).toEqual({ sigma: 0.02, refuted: true });
    expect(noiseOf({ ...NOISE_AS_READ, kind: "residuals" }, refuted, units)).toEqual({ refuted: true });
    expect(noiseOf({ ...NOISE_AS_READ, kind: "sigma", sigma: "30" }, refuted, units)).toEqual({ sigma: 0.03 });
    const sheet = {
      ...NOISE_AS_READ,
      kind: "instrument" as const,
      station: "-2000 500 1000",
      range: "10",
      rangePer: "0",
    };
    expect(noiseOf({ ...sheet, transverse: "15", transversePer: "6" }, null, units)).toEqual({
      instrument: {
        station: [-2000, 500, 1000],
        range: { constant: 0.01, per_distance: 0 },
        transverse: { constant: 0.015, per_distance: 6e-6 },
      },
    });
  });
});

describe("faults at their fields", () => {
  const problem = {
    detail: "2 faults; first: …",
    where: "priors.joint_2.stiffness",
    remedy: null,
    errors: [
      { where: "priors.joint_2.stiffness", reason: "must be a number", remedy: "give a number" },
      { where: "stiffness_bounds.joint_2[0]", reason: "must be at least 1", remedy: null },
    ],
  } as unknown as Problem;

  it("finds what is at a path or within it, not what only begins alike", () => {
    expect(faultsAt(problem, "priors.joint_2")).toEqual(["must be a number: give a number"]);
    expect(faultsAt(problem, "stiffness_bounds")).toEqual(["must be at least 1"]);
    expect(faultsAt(problem, "prior")).toEqual([]);
    expect(faultsAt(null, "priors")).toEqual([]);
  });

  it("leaves to the note what stands at no field", () => {
    expect(elsewhere(problem, ["priors"])).toMatchObject({
      where: null,
      errors: [{ where: "stiffness_bounds.joint_2[0]" }],
    });
    expect(elsewhere(problem, ["noise"])).toEqual(problem);
  });

  it("takes a problem of one fault, too", () => {
    const one = { ...problem, errors: [], where: "weighting", detail: "needs rotations" } as Problem;
    expect(faultsAt(one, "weighting")).toEqual(["needs rotations"]);
  });
});
