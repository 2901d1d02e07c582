/** Noise of readings and load as people state it, and as a measurement set has it. */
import type { MeasurementSet, Units } from "../api/types";
import { posted, vectorIn } from "./entered";
import { factors } from "./units";

type Noise = NonNullable<MeasurementSet["noise"]>;

/** As typed. `kind`: where the tracker's noise comes from, "" for what the readings say. */
export interface StatedNoise {
  kind: "" | "residuals" | "sigma" | "instrument";
  /** µm. */
  sigma: string;
  /** Position of the tracker in R0, mm. */
  station: string;
  /** µm, and µm per metre. */
  range: string;
  rangePer: string;
  transverse: string;
  transversePer: string;
  /** µrad. */
  encoder: string;
  /** %. */
  forceScale: string;
  /** mrad. */
  forceDirection: string;
  /** mm. */
  loadPoint: string;
  targetPlaces: string;
}

export const NOISE_AS_READ: StatedNoise = {
  kind: "",
  sigma: "",
  station: "",
  range: "",
  rangePer: "",
  transverse: "",
  transversePer: "",
  encoder: "",
  forceScale: "",
  forceDirection: "",
  loadPoint: "",
  targetPlaces: "",
};

const MICRO = 1e-6;

/** Whether anything is stated that the readings do not say. */
export const statesNoise = ({
  kind,
  range: _,
  rangePer: _r,
  transverse: _t,
  transversePer: _p,
  sigma: _s,
  station: _at,
  ...common
}: StatedNoise): boolean => kind !== "" || Object.values(common).some((typed) => typed.trim() !== "");

/** The noise to post with a set in `units` that had the noise `before`; what is no number goes as it was typed. */
export function noiseOf(stated: StatedNoise, before: Noise | null, units: Units): unknown {
  const { length, angle } = factors(units);
  const uncertainty = (constant: string, per: string) => ({
    constant: posted(constant, MICRO / length) ?? 0,
    per_distance: posted(per, MICRO) ?? 0,
  });
  const station = vectorIn(stated.station);
  const tracker = {
    "": { sigma: before?.sigma ?? null, instrument: before?.instrument ?? null },
    residuals: {},
    sigma: { sigma: posted(stated.sigma, MICRO / length) },
    instrument: {
      instrument: {
        station: station ? station.map((typed) => Number(((typed * 1e-3) / length).toPrecision(15))) : [],
        range: uncertainty(stated.range, stated.rangePer),
        transverse: uncertainty(stated.transverse, stated.transversePer),
      },
    },
  }[stated.kind];
  const scale = posted(stated.forceScale, 0.01);
  const direction = posted(stated.forceDirection, 1e-3);
  const noise = {
    ...before,
    ...{ sigma: null, instrument: null },
    ...tracker,
    encoder_sigma: posted(stated.encoder, MICRO / angle) ?? before?.encoder_sigma ?? null,
    force:
      scale === null && direction === null ? (before?.force ?? null) : { scale: scale ?? 0, direction: direction ?? 0 },
    load_point: posted(stated.loadPoint, 1e-3 / length) ?? before?.load_point ?? null,
    target_places: posted(stated.targetPlaces, 1e-3 / length) ?? before?.target_places ?? null,
    refuted: stated.kind === "" || stated.kind === "residuals" ? before?.refuted || null : null,
  };
  const said = Object.entries(noise).filter(([, value]) => value !== null && value !== undefined);
  return said.length === 0 ? null : Object.fromEntries(said);
}
