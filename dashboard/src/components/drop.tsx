/** Where files are dropped, or chosen with one tap. */
import { useId, useState } from "preact/hooks";

export function DropZone({
  title,
  hint,
  button,
  accept,
  take,
  several = false,
  compact = false,
}: {
  title: string;
  hint: string;
  button: string;
  accept: string;
  /** Without `several` there is one. */
  take: (file: File, ...others: File[]) => void;
  several?: boolean;
  compact?: boolean;
}) {
  const [over, setOver] = useState(false);
  const id = useId();
  const given = (files: FileList | null | undefined) => {
    const [first, ...others] = files ?? [];
    if (first) take(first, ...(several ? others : []));
  };
  const dropped = (event: DragEvent) => {
    event.preventDefault();
    setOver(false);
    given(event.dataTransfer?.files);
  };
  const chosen = (event: Event & { currentTarget: HTMLInputElement }) => {
    given(event.currentTarget.files);
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
      <input class="hidden" id={id} type="file" accept={accept} multiple={several} onChange={chosen} />
      <label class={compact ? "button" : "button primary"} for={id}>
        {button}
      </label>
    </div>
  );
}
