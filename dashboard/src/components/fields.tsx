/** Fields of a form: what is typed, its unit, one sentence of help, and the faults that the service found in it. */
import type { ComponentChildren } from "preact";
import { useId } from "preact/hooks";
import { numberIn, vectorIn } from "../lib/entered";
import { Prose } from "./basics";

export interface Hints {
  help?: string | undefined;
  faults?: string[] | undefined;
}

/** A label with its unit over a control; help and faults beneath, said with the control. */
export function Field({
  label,
  unit,
  help,
  faults = [],
  children,
}: Hints & {
  label: string;
  unit?: string | undefined;
  children: (control: {
    id: string;
    "aria-describedby": string | undefined;
    "aria-invalid": boolean;
  }) => ComponentChildren;
}) {
  const id = useId();
  const said = help !== undefined || faults.length > 0;
  return (
    <div class="field">
      <label for={id}>{unit === undefined ? label : `${label} [${unit}]`}</label>
      {children({ id, "aria-describedby": said ? `${id}-said` : undefined, "aria-invalid": faults.length > 0 })}
      {said && (
        <small id={`${id}-said`}>
          <Faults faults={faults} />
          {help !== undefined && <Prose text={help} />}
        </small>
      )}
    </div>
  );
}

/** What the service says against a field. */
export function Faults({ faults }: { faults: string[] }) {
  return (
    <>
      {faults.map((fault) => (
        <span class="fault" role="alert">
          <Prose text={fault} />
        </span>
      ))}
    </>
  );
}

/** One number. */
export function NumberField({
  value,
  change,
  placeholder,
  ...rest
}: Hints & {
  label: string;
  unit?: string | undefined;
  value: string;
  change: (typed: string) => void;
  placeholder?: string;
}) {
  return (
    <Field {...rest}>
      {(control) => (
        <NumberBox value={value} change={change} {...(placeholder === undefined ? {} : { placeholder })} {...control} />
      )}
    </Field>
  );
}

/** The box of a number: marked where it holds none. */
export function NumberBox({
  value,
  change,
  ...rest
}: {
  value: string;
  change: (typed: string) => void;
  id?: string;
  placeholder?: string;
  "aria-label"?: string;
  "aria-describedby"?: string | undefined;
  "aria-invalid"?: boolean;
}) {
  return (
    <input
      type="text"
      inputMode="decimal"
      autocomplete="off"
      {...rest}
      value={value}
      aria-invalid={rest["aria-invalid"] || Number.isNaN(numberIn(value))}
      onInput={(event) => change(event.currentTarget.value)}
    />
  );
}

/** Three numbers along x, y and z in one box. */
export function VectorField({
  value,
  change,
  placeholder = "0, 0, 0",
  ...rest
}: Hints & {
  label: string;
  unit?: string | undefined;
  value: string;
  change: (typed: string) => void;
  placeholder?: string;
}) {
  return (
    <Field {...rest}>
      {(control) => (
        <input
          type="text"
          autocomplete="off"
          placeholder={placeholder}
          {...control}
          value={value}
          aria-invalid={control["aria-invalid"] || vectorIn(value) === undefined}
          onInput={(event) => change(event.currentTarget.value)}
        />
      )}
    </Field>
  );
}
