/** Steps of the way from files to a result, and all that a run can be told beside its readings. */
import { useContext, useEffect, useRef, useState } from "preact/hooks";
import { Toggle, Button, ProblemNote } from "../../components/basics";
import { FormProblem } from "../../components/fields";
import { SchemaFields, type Terms, DropZone } from "../../components/schema_form";
import { faultsAt, type Fields, stated, elsewhere } from "../../lib/json";
import type { StatedNoise } from "../../lib/campaign";
import { text } from "../../words";
import type { ComponentChildren } from "preact";
import type { Action } from "../../state/action";
import { useTypedValue } from "../../state/session";
import { settingWords } from "./words";

const words = settingWords;
const { mm } = text.units;

const GROUPS = {
  fit: ["method", "elasticity", "loss", "huber_threshold", "weighting", "characteristic_length", "confidence"],
  held: ["positive", "complementary_stiffness", "weight", "resampling"],
  elastic: ["links", "link_penalty", "cross_validation"],
  knowledge: ["stiffness_bounds", "priors", "stiffness_order"],
} as const;

/** Fields that only some choices use: what was typed before another choice does not get in its way. */
const USED: Record<string, (run: Fields) => boolean> = {
  huber_threshold: ({ loss }) => loss === "huber",
  characteristic_length: ({ weighting }) => weighting === "characteristic_length",
  link_penalty: ({ elasticity = "automatic" }) => elasticity !== "joints" && elasticity !== "automatic",
  cross_validation: ({ elasticity }) => elasticity !== "joints",
  links: ({ elasticity }) => !["joints", "coupled_joints", "joints_and_base"].includes(String(elasticity)),
};

/** Fields of a request that stand here: a fault in one of them opens the fold. */
export const SETTINGS_FIELDS = [...Object.values(GROUPS).flat(), "noise"];

const isUsed = (run: Fields) => (name: string) => USED[name]?.(run) ?? true;

/** The request of a run: what was stated, and is used. */
export const requestOf = (set: string, run: Fields): Fields => ({
  measurement_set_id: set,
  ...(stated(Object.fromEntries(Object.entries(run).filter(([name]) => isUsed(run)(name)))) as Fields),
});

const SEEDS = { resampling: { size: 10, seed: 1 } };
export const NOISE: Terms = {
  labels: words.noise,
  within: "noise.",
  seeds: { instrument: { range: {}, transverse: {} } },
  units: {
    load_point: [mm, 1e-3],
    target_places: [mm, 1e-3],
    drift: ["µm", 1e-6],
    "force.direction": ["mrad", 1e-3],
    "instrument.station": [mm, 1e-3],
  },
};

/** What a run and its noise are told; `readings`: a name of what is identified, which has a form of its own. */
export function useRunForm(readings: string) {
  const [run, setRun] = useTypedValue<Fields>(`identify/${readings}`, {});
  const [noise, setNoise] = useTypedValue<StatedNoise>(`identify/${readings}/noise`, {});
  return { run, setRun, noise, setNoise, request: (set: string) => requestOf(set, run) };
}

export type RunForm = ReturnType<typeof useRunForm>;

interface AdvancedProps {
  form: RunForm;
  joints: string[];
}

/** `joints`: names of the robot's joints; empty while no robot is chosen. */
export function Advanced({ form: { run, setRun, noise, setNoise, request }, joints }: AdvancedProps) {
  const problem = useContext(FormProblem);
  const [open, setOpen] = useState(false);
  const details = useRef<HTMLDetailsElement>(null);
  useEffect(() => {
    if (!SETTINGS_FIELDS.some((path) => faultsAt(problem, path).length > 0)) return;
    setOpen(true);
    setTimeout(() => details.current?.querySelector(".fault")?.scrollIntoView({ block: "center" }));
  }, [problem]);
  const terms: Terms = { labels: words.labels, seeds: SEEDS, joints, hidden: ["weight.gravity", "weight.balancers"] };
  return (
    <details
      class="card wide settings"
      ref={details}
      open={open}
      onToggle={(event) => setOpen(event.currentTarget.open)}
    >
      <summary>
        {words.title} <small class="soft">{changesIn(request("")) || words.defaults}</small>
      </summary>
      {open && (
        <>
          {Object.values(GROUPS).map((names) => (
            <fieldset>
              <SchemaFields
                of="RunRequest"
                show={names.filter(isUsed(run))}
                value={run}
                change={setRun}
                terms={terms}
              />
            </fieldset>
          ))}
          <fieldset>
            <legend>{words.noiseTitle}</legend>
            <p class="soft">{words.noiseHelp}</p>
            <Toggle
              label={words.residuals}
              checked={noise.residuals ?? false}
              change={(residuals) => setNoise({ ...noise, residuals })}
            />
            <SchemaFields
              of="Noise"
              show={[
                "sigma",
                "instrument",
                "force",
                "load_point",
                "grounds",
                "target_places",
                "drift",
                "encoder_sigma",
                "repeatability",
              ]}
              value={noise}
              change={setNoise}
              terms={NOISE}
            />
          </fieldset>
        </>
      )}
    </details>
  );
}

/** What differs from the defaults: single values as they are, of others their name. */
function changesIn({ measurement_set_id: _, ...request }: Fields): string {
  const said = Object.entries(request).map(([name, value]) => {
    const plain = name.replaceAll("_", " ");
    if (name === "characteristic_length") return `${plain}: ${1e3 * Number(value)} ${mm}`;
    return typeof value === "object" ? plain : `${plain}: ${String(value).replaceAll("_", " ")}`;
  });
  return said.join(", ");
}

const ACCEPTED =
  ".json,.csv,.tsv,.txt,.asc,.xyz,.dat,.xlsx,.xls,.xlsb,.ods,.mat,.h5,.hdf5,.npz,.npy,.parquet,application/json,text/csv,text/plain";

export function FileDrop({ again, take }: { again: boolean; take: (...files: File[]) => void }) {
  return (
    <DropZone
      title={text.files.drop}
      hint={text.files.dropHint}
      accept={ACCEPTED}
      several
      compact={again}
      button={again ? text.files.another : text.files.choose}
      take={take}
    />
  );
}

/** A step of a flow, with its number. */
export const Step = ({ at, title, wide = false, children }: StepProps) => (
  <section class={wide ? "card wide" : "card"} aria-labelledby={`step-${at}`}>
    <h2 id={`step-${at}`}>
      <span class="step">{at}</span>
      {title}
    </h2>
    {children}
  </section>
);

interface StepProps {
  at: number;
  title: string;
  wide?: boolean;
  children: ComponentChildren;
}

/** A file that is none of ours: what is wrong, and what to do. */
export const Refused = ({ file, why: [title = "", remedy = ""] }: { file: string; why: readonly string[] }) => (
  <ProblemNote problem={{ title, detail: file, remedy }} />
);

/** The one button at the end of a flow, and why it cannot be pressed yet. */
export function GoBar({ action, ready, why }: { action: Action<[]>; ready: boolean; why: string | null }) {
  return (
    <div class={ready ? "gobar wide ready" : "gobar wide"}>
      {action.problem && <ProblemNote problem={elsewhere(action.problem, SETTINGS_FIELDS)} />}
      <div class="go">
        <Button acts look="primary big" disabled={!ready || action.busy} onClick={action.run}>
          {action.busy ? text.start.going : text.app.measure}
        </Button>
        {!ready && why !== null && <span class="soft">{why}</span>}
      </div>
    </div>
  );
}
