/** Where a file is dropped, or chosen with one tap. */
import { useId, useState } from "preact/hooks";

export function DropZone({
  title,
  hint,
  button,
  accept,
  take,
  compact = false,
}: {
  title: string;
  hint: string;
  button: string;
  accept: string;
  take: (file: File) => void;
  compact?: boolean;
}) {
  const [over, setOver] = useState(false);
  const id = useId();
  const dropped = (event: DragEvent) => {
    event.preventDefault();
    setOver(false);
    const file = event.dataTransfer?.files[0];
    if (file) take(file);
  };
  const chosen = (event: Event & { currentTarget: HTMLInputElement }) => {
    const file = event.currentTarget.files?.[0];
    if (file) take(file);
    event.currentTarget.value = ""; // so that the same file can be chosen again
  };
  return (
    <div
      class={`drop${over ? " over" : ""}${compact ? " compact" : ""}`}
      onDragOver={(event) => {
        event.preventDefault();
        setOver(true);
      }}
      onDragLeave={() => setOver(false)}
      onDrop={dropped}
    >
      {!compact && (
        <>
          <svg viewBox="0 0 48 48" aria-hidden="true">
            <path d="M24 32V10M15 19l9-9 9 9M8 30v8h32v-8" />
          </svg>
          <p class="lead">{title}</p>
          <p>{hint}</p>
        </>
      )}
      <input class="hidden" id={id} type="file" accept={accept} onChange={chosen} />
      <label class={compact ? "button" : "button primary"} for={id}>
        {button}
      </label>
    </div>
  );
}
