/** What was chosen to be shown on the arm beside a result: it is said in the address, so that a link shows the same. */
import { readdress } from "../../state/action";

export interface Chosen {
  /** Name of a joint, of a row or of a bar. */
  joint: string | null;
  /** Label of a configuration, of a bar. */
  at: string | null;
}

export const chosenIn = (query: URLSearchParams): Chosen => ({ joint: query.get("joint"), at: query.get("at") });

/** Choose a joint; the same once more: none. */
export function chooseJoint(name: string): void {
  readdress((now) => {
    const { joint: before, ...others } = Object.fromEntries(now);
    return name === before ? others : { ...others, joint: name };
  });
}
