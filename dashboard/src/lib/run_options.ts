/** How to identify: what the form of a run holds, and the request that comes of it. Defaults left alone are not sent. */
import type { Elasticity, Loss, Method, Weighting } from "../api/types";
import { posted } from "./entered";

/** Two fields of one joint, as typed: least and greatest stiffness, or stiffness and its standard uncertainty. */
export type Two = [string, string];

/** Two joints, the first at least as stiff as the second. */
export type Order = [string, string];

export interface Options {
  method: Method;
  positive: boolean;
  loss: Loss | "";
  complementary: boolean;
  resample: boolean;
  repetitions: number;
  size: number;
  confidence: string;
  elasticity: Elasticity;
  weighting: Weighting;
  /** As typed, mm. */
  characteristicLength: string;
  huberThreshold: string;
  /** By joint, as typed, in the page's unit of stiffness. */
  bounds: Record<string, Two>;
  priors: Record<string, Two>;
  orders: Order[];
  links: string[];
  linkPenalty: string;
  folds: string;
  foldSeed: string;
  rule: "best" | "one_standard_error";
  seed: string;
  replacement: boolean;
}

export const initialOptions: Options = {
  method: "partial_pose",
  positive: true,
  loss: "",
  complementary: true,
  resample: false,
  repetitions: 1000,
  size: 10,
  confidence: "0.95",
  elasticity: "automatic",
  weighting: "covariance",
  characteristicLength: "",
  huberThreshold: "",
  bounds: {},
  priors: {},
  orders: [],
  links: [],
  linkPenalty: "",
  folds: "",
  foldSeed: "",
  rule: "best",
  seed: "1",
  replacement: false,
};

/** Losses that go with an elasticity, besides the default. */
export function lossesOf(elasticity: Elasticity): Loss[] {
  return elasticity === "joints" || elasticity === "automatic" ? ["squared", "huber"] : ["squared", "huber", "absolute"];
}

/** Whether links are elastic, so that they can be chosen. */
export const hasLinks = (elasticity: Elasticity): boolean => !["joints", "coupled_joints"].includes(elasticity);

/**
 * The request of a run.
 *
 * `stiffness`: the factor from the page's unit of stiffness to N·m/rad. Fields that the chosen method, loss or elasticity
 * has no use for are not sent, so that what was typed before another choice does not get in its way.
 */
export function requestOf(set: string, options: Options, stiffness = 1): Record<string, unknown> {
  const loss = lossesOf(options.elasticity).includes(options.loss as Loss) ? options.loss : "";
  const elastic = options.elasticity !== "joints";
  const byLength = options.weighting === "characteristic_length";
  return without({
    measurement_set_id: set,
    method: unless(options.method, "partial_pose"),
    weighting: unless(options.weighting, "covariance"),
    characteristic_length: byLength ? posted(options.characteristicLength, 1e-3) : null,
    positive: unless(options.positive, true),
    stiffness_bounds: filled(options.bounds, ([least, greatest]) => [
      posted(least, stiffness),
      posted(greatest, stiffness),
    ]),
    priors: filled(options.priors, ([value, uncertainty]) => ({
      stiffness: posted(value, stiffness),
      standard_uncertainty: posted(uncertainty, stiffness),
    })),
    stiffness_order: options.orders.filter(([first, second]) => first !== "" || second !== ""),
    loss,
    huber_threshold: loss === "huber" ? posted(options.huberThreshold) : null,
    complementary_stiffness: options.complementary ? null : "neglected",
    elasticity: unless(options.elasticity, "automatic"),
    links: hasLinks(options.elasticity) ? options.links : [],
    link_penalty: elastic && options.elasticity !== "automatic" ? posted(options.linkPenalty) : null,
    cross_validation: elastic
      ? without({ folds: posted(options.folds), seed: posted(options.foldSeed), rule: unless(options.rule, "best") })
      : {},
    resampling: options.resample
      ? without({
          size: options.size,
          repetitions: options.repetitions,
          seed: posted(options.seed),
          replacement: unless(options.replacement, false),
        })
      : {},
    confidence: unless(Number(options.confidence), 0.95),
  });
}

const unless = <Value>(value: Value, standard: Value): Value | null => (value === standard ? null : value);

/** Joints where something was typed. */
function filled<Sent>(typed: Record<string, Two>, sent: (two: Two) => Sent): Record<string, Sent> {
  const rows = Object.entries(typed).filter(([, two]) => two.some((cell) => cell.trim() !== ""));
  return Object.fromEntries(rows.map(([joint, two]) => [joint, sent(two)]));
}

/** The fields that say something. */
function without(fields: Record<string, unknown>): Record<string, unknown> {
  return Object.fromEntries(Object.entries(fields).filter(([, value]) => !isEmpty(value)));
}

const isEmpty = (value: unknown): boolean =>
  value === null || value === "" || (typeof value === "object" && Object.keys(value).length === 0);
