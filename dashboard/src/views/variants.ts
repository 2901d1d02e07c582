/** Runs that vary another by one action: other options, fewer readings, or corrected readings and robots. */
import { api } from "../api/client";
import type { Action, MeasurementSet, Run, RunRequest } from "../api/types";
import { corrected, withJointMap } from "../lib/corrections";
import { contentKey } from "../lib/hash";
import { noiseOf, type StatedNoise } from "../lib/noise";
import { namesChanged } from "../state/names";
import { text } from "../i18n";
import type { RunContext } from "./run_context";

/** Carry out an action; pressed twice it gives the same run. */
export async function variantBy({ run, set, robot }: RunContext, action: Action): Promise<Run> {
  const asked: RunRequest = { ...run.request, variant_of: run.id };
  switch (action.kind) {
    case "leave_out_readings":
      return post({ ...asked, leave_out: [...new Set([...asked.leave_out, ...action.observations])] });
    case "use_huber":
      return post({ ...asked, loss: "huber" });
    case "include_complementary_stiffness":
      return post({ ...asked, complementary_stiffness: "included" });
    case "choose_model":
      return post({ ...asked, elasticity: "automatic", loss: "automatic" });
    case "apply_joint_map": {
      const named = withJointMap(robot, action, text.assessment.corrected.map(robot.name));
      const added = await api.robots.add(named, contentKey("robot", named));
      return onOtherSet(asked, { ...bare(set), robot_id: added.id });
    }
    default: {
      const name = `${set.name} (${text.assessment.corrected[action.kind](action)})`;
      return onOtherSet(asked, {
        ...corrected(
          bare(set),
          action,
          robot.joints.map((joint) => joint.name),
        ),
        name,
      });
    }
  }
}

const post = (request: RunRequest): Promise<Run> => api.runs.add(request, contentKey("run", request));

async function onOtherSet(request: RunRequest, document: Bare): Promise<Run> {
  const added = await stored(document);
  return post({ ...request, measurement_set_id: added.id });
}

/** The set with another noise, stored as a set of its own. */
export async function withNoise(set: MeasurementSet, noise: StatedNoise): Promise<MeasurementSet> {
  const name = `${set.name} (${text.assessment.corrected.noise})`;
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
