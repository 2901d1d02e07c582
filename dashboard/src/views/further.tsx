/** Warnings that no reason says, folded away: the verdict does not rest on them. */
import type { QualityWarning } from "../api/types";
import { Warnings } from "../components/basics";
import { text } from "../i18n";

export function Further({ warnings }: { warnings: QualityWarning[] }) {
  if (warnings.length === 0) return null;
  return (
    <details class="card further">
      <summary>{text.assessment.more(warnings.length)}</summary>
      <Warnings warnings={warnings} />
    </details>
  );
}
