/** What the integrity checks say of readings. */
import type { QualityWarning } from "../api/types";
import { text } from "../i18n";
import { Warnings } from "./basics";

export function Findings({ warnings }: { warnings: QualityWarning[] }) {
  if (warnings.length === 0) return <p class="note good">{text.files.clean}</p>;
  return (
    <>
      <h3>{text.files.findings(warnings.length)}</h3>
      <Warnings warnings={warnings} />
    </>
  );
}
