/** How to identify: what the form of a run holds, and the request that comes of it. Defaults left alone are not sent. */
import type { Elasticity, Loss, Method, RunOptions, Weighting } from "../api/types";
import { posted } from "./entered";
import type { Fields } from "./json";

/** Two fields of one joint, as typed: least and greatest stiffness, or stiffness and its standard uncertainty. */
export type Two = [string, string];

/** Two joints, the first at least as stiff as the second. */
export type Order = [string, string];

export interface Options {
  method: Method;
  positive: boolean;
  loss: Loss | "";
  complementary: boolean;
  /** The robot's own weight is the load. */
  ownWeight: boolean;
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
  foldDraws: string;
  foldSeed: string;
  rule: "best" | "one_standard_error";
  resample: boolean;
  repetitions: string;
  size: string;
  seed: string;
  replacement: boolean;
  /** Fields of a file that the form does not show: sent as they stand. */
  given: Fields;
}

export const initialOptions: Options = {
  method: "partial_pose",
  positive: true,
  loss: "",
  complementary: true,
  ownWeight: false,
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
  foldDraws: "",
  foldSeed: "",
  rule: "best",
  resample: false,
  repetitions: "1000",
  size: "10",
  seed: "1",
  replacement: false,
  given: {},
};

/** Losses that go with an elasticity, besides the default. */
export function lossesOf(elasticity: Elasticity): Loss[] {
  return elasticity === "joints" || elasticity === "automatic"
    ? ["squared", "huber"]
    : ["squared", "huber", "absolute"];
}

/** Whether links are elastic, so that they can be chosen. */
export const hasLinks = (elasticity: Elasticity): boolean =>
  !["joints", "coupled_joints", "joints_and_base"].includes(elasticity);

/**
 * The request of a run.
 *
 * `stiffness`: the factor from the page's unit of stiffness to N·m/rad. Fields that the chosen method, loss or elasticity
 * has no use for are not sent, so that what was typed before another choice does not get in its way.
 */
export function requestOf(set: string, options: Options, stiffness = 1): Fields {
  const usual = fieldsOf(initialOptions, stiffness);
  const changed = Object.entries(fieldsOf(options, stiffness)).filter(([name, value]) => value !== usual[name]);
  return { measurement_set_id: set, ...without(Object.fromEntries(changed)), ...options.given };
}

function fieldsOf(options: Options, stiffness: number): Fields {
  const loss = lossesOf(options.elasticity).includes(options.loss as Loss) ? options.loss : "";
  const elastic = options.elasticity !== "joints";
  const byLength = options.weighting === "characteristic_length";
  return {
    method: options.method,
    weighting: options.weighting,
    characteristic_length: byLength ? posted(options.characteristicLength, 1e-3) : null,
    positive: options.positive,
    stiffness_bounds: filled(options.bounds, ([least, greatest]) => [
      posted(least, stiffness),
      posted(greatest, stiffness),
    ]),
    priors: filled(options.priors, ([value, uncertainty]) => ({
      stiffness: posted(value, stiffness),
      standard_uncertainty: posted(uncertainty, stiffness),
    })),
    stiffness_order: options.orders.filter(([first, second]) => first !== "" || second !== ""),
    loss: loss || "automatic",
    huber_threshold: loss === "huber" ? posted(options.huberThreshold) : null,
    complementary_stiffness: options.complementary ? "included" : "neglected",
    weight: options.ownWeight ? { estimate_gravity: false } : null,
    elasticity: options.elasticity,
    links: hasLinks(options.elasticity) ? options.links : [],
    link_penalty: elastic && options.elasticity !== "automatic" ? posted(options.linkPenalty) : null,
    cross_validation: elastic
      ? without({
          folds: posted(options.folds),
          draws: posted(options.foldDraws),
          seed: posted(options.foldSeed),
          rule: options.rule === "best" ? null : options.rule,
        })
      : {},
    resampling: options.resample
      ? without({
          size: posted(options.size),
          repetitions: posted(options.repetitions),
          seed: posted(options.seed),
          replacement: options.replacement || null,
        })
      : {},
    confidence: Number(options.confidence),
  };
}

/** The form as the `run` of a campaign file fills it; what it cannot show is kept and sent as it stands. */
export function optionsOf(run: Partial<RunOptions>, stiffness = 1): Options {
  try {
    const options = shownOf(run, stiffness);
    const shown = fieldsOf(options, stiffness);
    const unseen = ([name, value]: [string, unknown]) =>
      isEmpty(shown[name]) || (typeof value === "string" && value !== shown[name]);
    return { ...options, given: without(Object.fromEntries(Object.entries(run).filter(unseen))) };
  } catch {
    return { ...initialOptions, given: run }; // of another shape: the service says what is wrong
  }
}

function shownOf(run: Partial<RunOptions>, stiffness: number): Options {
  const { cross_validation: validation, resampling } = run;
  const typed = (value: unknown, factor = 1): string =>
    value === null || value === undefined ? "" : typeof value === "number" ? String(value / factor) : String(value);
  const twos = <Value>(values: Record<string, Value> | undefined, two: (value: Value) => unknown[]) =>
    Object.fromEntries(
      Object.entries(values ?? {}).map(([joint, value]) => {
        const [first, second] = two(value);
        return [joint, [typed(first, stiffness), typed(second, stiffness)] as Two];
      }),
    );
  return {
    ...initialOptions,
    method: run.method ?? initialOptions.method,
    positive: run.positive ?? initialOptions.positive,
    loss: run.loss === undefined || run.loss === "automatic" ? "" : run.loss,
    complementary: run.complementary_stiffness !== "neglected",
    ownWeight: !!run.weight && Object.keys(run.weight).length === 0,
    confidence: typed(run.confidence) || initialOptions.confidence,
    elasticity: run.elasticity ?? initialOptions.elasticity,
    weighting: run.weighting ?? initialOptions.weighting,
    characteristicLength: typed(run.characteristic_length, 1e-3),
    huberThreshold: typed(run.huber_threshold),
    bounds: twos(run.stiffness_bounds, (bounds) => bounds),
    priors: twos(run.priors, (prior) => [prior.stiffness, prior.standard_uncertainty]),
    orders: (run.stiffness_order ?? []).flatMap((chain) =>
      chain.slice(1).map((softer, i): Order => [chain[i] ?? "", softer]),
    ),
    links: run.links ?? [],
    linkPenalty: typed(run.link_penalty),
    folds: typed(validation?.folds),
    foldDraws: typed(validation?.draws),
    foldSeed: typed(validation?.seed),
    rule: validation?.rule ?? "best",
    ...(resampling && {
      resample: true,
      size: typed(resampling.size),
      repetitions: typed(resampling.repetitions),
      seed: typed(resampling.seed),
      replacement: resampling.replacement ?? false,
    }),
  };
}

/** Joints where something was typed. */
function filled<Sent>(typed: Record<string, Two>, sent: (two: Two) => Sent): Record<string, Sent> {
  const rows = Object.entries(typed).filter(([, two]) => two.some((cell) => cell.trim() !== ""));
  return Object.fromEntries(rows.map(([joint, two]) => [joint, sent(two)]));
}

/** The fields that say something. */
function without(fields: Fields): Fields {
  return Object.fromEntries(Object.entries(fields).filter(([, value]) => !isEmpty(value)));
}

const isEmpty = (value: unknown): boolean =>
  value === null ||
  value === undefined ||
  value === "" ||
  (typeof value === "object" && Object.keys(value).length === 0);
