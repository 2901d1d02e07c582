/** Runs that vary another: by an action of its assessment, or with another noise. */
import { api } from "../api/client";
import type { Action, MeasurementSet, Run } from "../api/types";
import { contentKey } from "../lib/hash";
import { noiseOf, type StatedNoise } from "../lib/noise";
import { namesChanged } from "../state/names";
import { text } from "../i18n";

/** Carry out an action; pressed twice it gives the same run. */
export async function variantBy(run: Run, action: Action): Promise<Run> {
  const made = await api.apply(run.id, action);
  namesChanged();
  return made;
}

/** The set with another noise, stored as a set of its own. */
export async function withNoise(set: MeasurementSet, noise: StatedNoise): Promise<MeasurementSet> {
  const name = `${set.name} (${text.assessment.noiseStated})`;
  return stored({ ...bare(set), name, noise: noiseOf(noise, set.noise, set.units) });
}

async function stored(document: unknown): Promise<MeasurementSet> {
  const added = await api.sets.add(document, contentKey("set", document));
  namesChanged();
  return added;
}

type Bare = Omit<MeasurementSet, "id" | "warnings" | "archived" | "content_hash" | "created_at" | "resolved_frame">;

/** A set as it was posted. */
function bare({
  id: _,
  warnings: _w,
  archived: _a,
  content_hash: _h,
  created_at: _c,
  resolved_frame: _f,
  ...document
}: MeasurementSet): Bare {
  return document;
}
