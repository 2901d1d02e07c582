/** Forms from what their fields are: a list says label, unit, help and place of each, and one renderer draws them. */
import type { ComponentProps } from "preact";
import { numbersIn } from "../lib/program";
import { Choice, type Options, Toggle } from "./basics";
import { NumberField, Select, TextField, VectorField } from "./fields";

/** How a field is typed, for those that are not plain text. */
type Kind = "text" | "number" | "vector" | "numbers" | "select" | "choice" | "toggle";

export type FieldOf<Values> = {
  [Name in keyof Values & string]: {
    name: Name;
    label: string;
    kind?: Kind;
    /** Of a select or a choice. */
    options?: Options<string>;
    /** Whether it is asked for at all. */
    asked?: boolean;
  } & Partial<Omit<ComponentProps<typeof TextField>, "label" | "value" | "change" | "name">>;
}[keyof Values & string];

/** The fields that are asked for; `change` hears the part that was changed. */
export function FormFields<Values extends object>({
  fields,
  values,
  change,
}: {
  fields: readonly FieldOf<Values>[];
  values: Values;
  change: (part: Partial<Values>) => void;
}) {
  return (
    <>
      {fields
        .filter(({ asked }) => asked !== false)
        .map(({ name, kind = "text", options = [], asked: _, ...rest }) => {
          const set = (value: unknown) => change({ [name]: value } as Partial<Values>);
          const value = values[name as keyof Values];
          const typed = { ...rest, value: String(value ?? ""), change: set };
          if (kind === "toggle") return <Toggle key={name} label={rest.label} checked={Boolean(value)} change={set} />;
          if (kind === "choice") return <Choice key={name} {...typed} options={options} />;
          if (kind === "select") return <Select key={name} {...typed} options={options} />;
          if (kind === "number") return <NumberField key={name} {...typed} />;
          if (kind === "vector") return <VectorField key={name} {...typed} />;
          const invalid = kind === "numbers" ? { "aria-invalid": numbersIn(typed.value) === null } : {};
          return <TextField key={name} {...typed} {...invalid} />;
        })}
    </>
  );
}
