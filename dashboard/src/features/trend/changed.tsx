/** Joints of a robot that changed, in a line of a list. */
import type { LastCampaign } from "../../api/types";
import { Name } from "../../components/basics";
import { text } from "../../words";
import { changeText } from "./trend";
import { trendWords } from "./words";

/** Which joints of a robot changed since its first campaign; of an arm that was not measured last, with its serial number. */
export function ChangedJoints({ of }: { of: LastCampaign | null }) {
  const [first, ...others] = of?.changed ?? [];
  if (!first) return null;
  return (
    <>
      <span class="state changed">{trendWords.changed}</span>{" "}
      <small>
        <Name>{first.joint}</Name> {changeText(first.change)}
        {first.serial_number !== of?.serial_number && (
          <>
            {" "}
            (<Name>{first.serial_number ?? trendWords.noSerial}</Name>)
          </>
        )}
        {others.length > 0 && ` ${text.more(others.length)}`}
      </small>
    </>
  );
}
