/** The box of a form in 3D, next to its fields: what is dragged is in its field, what is typed there is drawn. */
import type { ComponentChildren } from "preact";
import { Button } from "../components/basics";
import { type Box, boxAbout, boxIn } from "../lib/box";
import { sized } from "../lib/schema";
import type { Vector } from "../lib/vector";
import { useKinematics } from "../state/kinematics";
import { ArmView, roomOf } from "./view";
import { boxWords } from "./words";

const words = boxWords;
/** Half of a box that nobody typed [m]. */
const HALF: Vector = [0.2, 0.2, 0.1];

interface BoxViewProps {
  robot: string;
  /** Where the arm stands [rad, m]. */
  joints: number[];
  /** Two corners as the form has them, or what is typed so far. */
  value: unknown;
  /** Unit of the form [m]. */
  unit: number;
  change: (corners: number[][]) => void;
  children: ComponentChildren;
}

export function BoxView({ robot, joints, value, unit, change, children }: BoxViewProps) {
  const posture = useKinematics({ robot_id: robot }, [joints]).kinematics?.[0];
  const box = boxIn(value, unit);
  const put = (box: Box) => change(sized(box as unknown as number[][], 1 / unit));
  return (
    <div class="boxed">
      <div class="view">
        <ArmView
          posture={posture}
          axes={false}
          room={[...(posture ? roomOf([posture]) : []), ...(box ?? [])]}
          label={words.view}
          {...(box ? { box } : {})}
          dragged={put}
        />
        {box ? (
          <p class="soft">{words.hint}</p>
        ) : (
          <Button disabled={!posture} onClick={() => posture && put(boxAbout(posture.flange_origin, HALF))}>
            {words.begin}
          </Button>
        )}
      </div>
      {children}
    </div>
  );
}
