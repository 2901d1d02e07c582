/** Fields of a form: what is typed, its unit, one sentence of help, and the faults that the service found in it. */
import { type ComponentChildren, createContext } from "preact";
import { useContext, useId, useRef } from "preact/hooks";
import type { Problem } from "../api/types";
import type { Action } from "../state/action";
import { faultsAt } from "../lib/json";
import { Busy, type Options, optionsOf, Prose } from "./basics";

interface Hints {
  help?: string | undefined;
  /** Place of the field in the request: what the service says against it stands here. */
  path?: string | undefined;
}

/** What the service said against a form. */
export const FormProblem = createContext<Problem | null>(null);

interface RequestFieldsProps {
  action: Action<never>;
  look: string;
  /** Whether everything is known that the form begins with: its fields, names and preset values. */
  known: boolean;
  children: ComponentChildren;
}

/**
 * Fields of a request: each says what the service said against it. The form is drawn once everything is known that it
 * begins with, so that no late answer moves what is shown. A drawn form stays.
 */
export function RequestFields({ action, look, known, children }: RequestFieldsProps) {
  const isDrawn = useRef(false);
  isDrawn.current ||= known;
  if (!isDrawn.current) return <Busy />;
  return (
    <FormProblem.Provider value={action.problem}>
      <div class={look}>{children}</div>
    </FormProblem.Provider>
  );
}

/** What it says against the field at a place. */
function useFaults(path: string | undefined): string[] {
  const problem = useContext(FormProblem);
  return path === undefined ? [] : faultsAt(problem, path);
}

export const FaultsAt = ({ path }: { path: string }) => <Faults faults={useFaults(path)} />;

interface FieldProps {
  label: string;
  unit?: string | undefined;
  children: (control: {
    id: string;
    "aria-describedby": string | undefined;
    "aria-invalid": boolean;
  }) => ComponentChildren;
}

/** A label with its unit over a control; help and faults beneath, said with the control. */
export function Field({ label, unit, help, path, children }: Hints & FieldProps) {
  const id = useId();
  const faults = useFaults(path);
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

/** What the service says against a field: an `alert` where no note beside the form says it, too. */
export function Faults({ faults, role }: { faults: string[]; role?: "alert" }) {
  return (
    <>
      {faults.map((fault) => (
        <span class="fault" role={role}>
          <Prose text={fault} />
        </span>
      ))}
    </>
  );
}

interface Typed extends Hints {
  label: string;
  unit?: string | undefined;
  value: string;
  change: (typed: string) => void;
}

/** Of the box, where it is not plain. */
interface Box {
  type?: "text" | "password" | "search" | "number" | "date" | "datetime-local" | undefined;
  placeholder?: string | undefined;
  maxLength?: number | undefined;
  required?: boolean | undefined;
  "aria-invalid"?: boolean | undefined;
}

/** Text, in several `lines` if wanted: a box of one line grows with its text. What else there is goes to the box. */
export function TextField({
  label,
  unit,
  help,
  path,
  value,
  change,
  lines,
  type = "text",
  ...box
}: Typed & Box & { lines?: number | undefined }) {
  return (
    <Field {...{ label, unit, help, path }}>
      {(control) =>
        lines !== undefined ? (
          <textarea
            {...control}
            rows={lines}
            placeholder={box.placeholder}
            maxLength={box.maxLength}
            aria-invalid={control["aria-invalid"] || box["aria-invalid"] === true}
            value={value}
            onInput={(event) => change(event.currentTarget.value)}
          />
        ) : (
          <input
            type={type as "text"} // each type has attributes of its own; these are common
            autocomplete="off"
            {...control}
            {...box}
            aria-invalid={control["aria-invalid"] || box["aria-invalid"] === true}
            value={value}
            onInput={(event) => change(event.currentTarget.value)}
          />
        )
      }
    </Field>
  );
}

/** One of several, in a list that opens. */
export function Select({ label, value, change, options, help, path }: Typed & { options: Options<string> }) {
  return (
    <Field {...{ label, help, path }}>
      {(control) => (
        <select {...control} value={value} onChange={(event) => change(event.currentTarget.value)}>
          {optionsOf(options).map((option) => (
            <option value={option.value} selected={option.value === value} disabled={option.disabled ?? false}>
              {option.label}
            </option>
          ))}
        </select>
      )}
    </Field>
  );
}

interface HandleProps {
  label: string;
  /** The place in words. */
  said?: string;
  look?: string;
  /** The first place. */
  from?: number;
  count: number;
  value: number;
  change: (value: number) => void;
  children: ComponentChildren;
}

/** One place of many in a row, by a handle below its name. */
export const Handle = ({ label, said, look = "field", from = 0, count, value, change, children }: HandleProps) => (
  <label class={look}>
    <span>{children}</span>
    <input
      type="range"
      min={from}
      max={from + count - 1}
      step={1}
      value={value}
      aria-label={label}
      aria-valuetext={said}
      onInput={(event) => change(Number(event.currentTarget.value))}
    />
  </label>
);
