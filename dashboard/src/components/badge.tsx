/** Whether a result may be used: icon, word and colour, so that none of them is needed alone. */
import type { Usability } from "../api/types";
import { text } from "../i18n";
import { Icon } from "./basics";

const ICONS: Record<Usability, string> = {
  use: "M5 12.5l4.5 4.5L19 7.5",
  use_with_care: "M12 4L2.8 20h18.4zM12 10v4.5M12 17.2v.3",
  do_not_use: "M6 6l12 12M18 6L6 18",
};

export function Badge({ verdict, large = false }: { verdict: Usability; large?: boolean }) {
  return (
    <span class={`badge ${verdict}${large ? " large" : ""}`}>
      <Icon d={ICONS[verdict]} />
      {text.usability[verdict]}
    </span>
  );
}
