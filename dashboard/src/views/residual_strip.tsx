/** What each configuration leaves unexplained, as a strip to step by: the worst are found at a glance. */
import type { RunResult } from "../api/types";
import { tip } from "../charts/tip";
import { fixed } from "../lib/format";
import { useWidth } from "../state/size";
import { text } from "../i18n";
import { byObservation } from "./run_deflection";

const HEIGHT = 54;

export function ResidualStrip({
  result,
  names,
  at,
  choose,
}: {
  result: RunResult;
  names: string[];
  at: number;
  choose: (index: number) => void;
}) {
  const [box, width] = useWidth<HTMLDivElement>();
  const left = new Map(byObservation(result.residuals).map((one) => [one.name, one.after * 1e3]));
  const most = Math.max(1e-9, ...left.values());
  const step = width / Math.max(1, names.length);
  return (
    <div class="strip" ref={box}>
      <p class="soft">{text.scene.strip}</p>
      {width > 0 && (
        <svg width={width} height={HEIGHT} role="img" aria-label={text.scene.strip}>
          {names.map((name, i) => {
            const value = left.get(name) ?? 0;
            const high = (value / most) * (HEIGHT - 4);
            return (
              <g class={i === at ? "at" : undefined} onClick={() => choose(i)}>
                <rect class="left" x={i * step + step * 0.12} width={step * 0.76} y={HEIGHT - high} height={high} />
                <rect
                  class={i === at ? "hit column at" : "hit column"}
                  x={i * step}
                  width={step}
                  y={0}
                  height={HEIGHT}
                  {...tip([name, `${text.deflection.residual}: ${fixed(value, 3)} ${text.units.mm}`])}
                />
              </g>
            );
          })}
        </svg>
      )}
    </div>
  );
}
