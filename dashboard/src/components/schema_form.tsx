/** Forms of requests as the service describes them, by one renderer for all kinds of fields; files are dropped beside them. */
import { useId, useState, useContext, useLayoutEffect } from "preact/hooks";
import { METADATA } from "../api/types";
import type { Typed } from "../lib/campaign";
import { TextField, Faults, FaultsAt, FormProblem, Select } from "./fields";
import { createContext } from "preact";
import { type Codec, codecOf, isAmbiguous, OF_TEXT, plain, type Schema, type Schemas } from "../lib/schema";
import { isUnread, type Fields, faultsAt } from "../lib/json";
import { sentence } from "../lib/said";
import { queries } from "../api/queries";
import { radians, STIFFNESS_UNITS } from "../lib/stiffness";
import { isKnown, useQuery } from "../state/query";
import { useSettings } from "../state/session";
import { text } from "../words";
import { Button, Choice, type Options, Show, Toggle } from "./basics";
import { Scroll } from "./table";
import { formWords, metadataWords, jointWords } from "./words";

interface DropZoneProps {
  title: string;
  hint: string;
  button: string;
  accept: string;
  /** Without `several` there is one. */
  take: (file: File, ...others: File[]) => void;
  several?: boolean;
  compact?: boolean;
}

export function DropZone({ title, hint, button, accept, take, several = false, compact = false }: DropZoneProps) {
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

const words = metadataWords;

export const MetadataForm = ({ typed, change }: { typed: Typed; change: (typed: Typed) => void }) => (
  <>
    {METADATA.map((name) => (
      <TextField
        key={name}
        label={words.fields[name]}
        placeholder={words.placeholders[name] ?? ""}
        value={typed[name]}
        change={(next) => change({ ...typed, [name]: next })}
        {...(name === "measured_at" ? { help: words.zone, type: "datetime-local" } : {})}
        {...(name === "notes" ? { lines: 4, maxLength: 2000 } : { maxLength: 200 })}
      />
    ))}
  </>
);

/** What a page adds to the service's description, by place such as `load.force`. */
export interface Terms {
  labels?: Record<string, string>;
  /** Units that people use instead of those of the API, and their size. */
  units?: Record<string, readonly [string, number]>;
  /** What values begin with that are switched on. */
  seeds?: Record<string, unknown>;
  /** Names of the robot's joints, where a field has something for each. */
  joints?: string[];
  /** What is chosen from, where the page knows; few values are in view. */
  choices?: Record<string, Options<string>>;
  /** Places of enumerations whose values are all in view. */
  inView?: readonly string[];
  /** Places of what is left to files. */
  hidden?: readonly string[];
  /** Place of the document in the request, such as `noise.`. */
  within?: string;
}

const USUAL: Record<string, Unit> = {
  m: [text.units.mm, 1e-3],
  rad: [text.units.deg, radians(1)],
  N: [text.units.newton, 1],
  kg: ["kg", 1],
};

/** What is small, by name. */
const MICRO: Unit = [text.units.micrometre, 1e-6];
const FINE: Record<string, Unit> = {
  ...{ sigma: MICRO, constant: MICRO, uncertainty: MICRO, limit: MICRO },
  per_distance: [`${text.units.micrometre}/m`, 1e-6],
  ...{ encoder_sigma: ["µrad", 1e-6], repeatability: ["µrad", 1e-6] },
  ...{ scale: [text.units.share, 0.01], relative: [text.units.share, 0.01] },
};

interface Known {
  all: Schemas;
  terms: Terms;
}

const Form = createContext<Known>({ all: {}, terms: {} });

interface SchemaFieldsProps {
  of: string;
  show: readonly string[];
  value: Fields;
  change: (value: Fields) => void;
  terms?: Terms;
}

/** Whether the description of all fields is known: a form of `SchemaFields` begins with it. */
export const useDescribed = (): boolean => isKnown(useQuery(queries.schemas));

/** The fields `show` of the request that the service calls `of`. */
export function SchemaFields({ of, show, value, change, terms = {} }: SchemaFieldsProps) {
  const schemas = useQuery(queries.schemas);
  return (
    <Show of={schemas}>
      {(all) => (
        <Form.Provider value={{ all, terms }}>
          <div class="fields">
            <Properties
              schema={plain(all[of] ?? {}, all)}
              show={show}
              value={value}
              change={(next) => change(asFields(next))}
              path=""
            />
          </div>
        </Form.Provider>
      )}
    </Show>
  );
}

interface Part {
  schema: Schema;
  value: unknown;
  change: (value: unknown) => void;
  path: string;
}

const joined = (path: string, name: string): string => (path ? `${path}.${name}` : name);
const asFields = (value: unknown): Fields => (typeof value === "object" && value !== null ? (value as Fields) : {});

function Properties({ schema, show, value, change, path }: Part & { show?: readonly string[] }) {
  const document = asFields(value);
  const properties = schema.properties ?? {};
  return (
    <>
      {(show ?? Object.keys(properties)).map((name) => (
        <Property
          key={name}
          schema={properties[name] ?? {}}
          value={document[name]}
          change={(part) => change({ ...document, [name]: part })}
          path={joined(path, name)}
        />
      ))}
    </>
  );
}

/** A sentence of the description: of a choice what is said of the chosen value, else the first that says more than a name. */
function helpOf({ description = "", enum: values }: Schema, chosen: string): string | undefined {
  if (values) return new RegExp(`\\W${chosen}\\W:? (.*?\\.)(?=\\s|$)`, "s").exec(description)?.[1];
  return description.split(/(?<=\.)\s/).find((sentence) => sentence.split(" ").length > 3);
}

const spoken = (name: string): string => (name.charAt(0).toUpperCase() + name.slice(1)).replaceAll("_", " ");

function Property({ schema: raw, value, change, path }: Part) {
  const { all, terms } = useContext(Form);
  const unitOf = useUnits();
  const schema = plain(raw, all);
  const name = path.split(".").at(-1) ?? "";
  const [unit, factor] = terms.units?.[path] ?? FINE[name] ?? unitOf(schema);
  const label = terms.labels?.[path] ?? spoken(name);
  const place = (terms.within ?? "") + path;
  const usual = schema.default ?? "";
  const help = terms.labels?.[path] ? undefined : sentence(helpOf(schema, String(value ?? usual)) ?? "") || undefined;
  const described = { label, help, path: place };
  if (schema.const !== undefined || terms.hidden?.includes(path)) return null;
  if (schema.type === "boolean")
    return <Toggle label={label} checked={Boolean(value ?? schema.default)} change={change} />;
  const given = terms.choices?.[path];
  if (given || schema.enum) {
    const words = Object.fromEntries((schema.enum ?? []).map((one) => [one, wordOf(one)]));
    const asked = { ...described, value: String(value ?? usual), change: (to: string) => change(to || null) };
    if (terms.inView?.includes(path)) return <Choice {...asked} options={given ?? words} />;
    return <Select {...asked} options={given ?? (usual === "" ? { "": wordOf(""), ...words } : words)} />;
  }
  if (schema.oneOf) {
    const kinds = schema.oneOf.map((one) => plain(one, all));
    const kindOf = (one: Schema) => String(one.properties?.["kind"]?.const ?? "");
    const chosen = kinds.find((one) => kindOf(one) === asFields(value)["kind"]);
    const options = ["", ...kinds.map(kindOf)].map((one) => ({ value: one, label: wordOf(one) }));
    return (
      <>
        <Select
          {...described}
          value={chosen ? kindOf(chosen) : ""}
          options={options}
          change={(kind) => change(kind ? { ...asFields(value), kind } : null)}
        />
        {chosen && <Properties schema={chosen} value={value} change={change} path={path} />}
      </>
    );
  }
  if (schema.properties) {
    const on = !schema.nullable || (value !== null && value !== undefined);
    const switched = (to: boolean) => change(to ? (terms.seeds?.[path] ?? {}) : null);
    return (
      <>
        {schema.nullable && <Toggle label={label} checked={on} change={switched} />}
        {on && <Properties schema={schema} value={value} change={change} path={path} />}
      </>
    );
  }
  const several = schema.items?.enum ?? terms.joints ?? [];
  if (schema.items?.type === "string" && several.length > 0) {
    const chosen = Array.isArray(value) && value.length > 0 ? (value as string[]) : several; // none means all
    const toggled = (name: string, on: boolean) => {
      const next = several.filter((each) => (each === name ? on : chosen.includes(each)));
      change(next.length === several.length ? [] : next);
    };
    return (
      <fieldset class="choice">
        <legend>{label}</legend>
        <div class="toggles">
          {several.map((name) => (
            <Toggle label={WORDS[name] ?? name} checked={chosen.includes(name)} change={(on) => toggled(name, on)} />
          ))}
        </div>
        <small class="soft">{described.help}</small>
        <FaultsAt path={place} />
      </fieldset>
    );
  }
  const row = plain(schema.additionalProperties ?? schema.items ?? {}, all);
  if (row.properties || (schema.additionalProperties && row.prefixItems?.length === 2))
    return <Grid {...{ schema, value, change, path, label, help: described.help }} />;
  const codec = codecOf(schema, all, factor);
  if (!codec) return null;
  const empty = schema.default === undefined || typeof schema.default === "object" ? "" : codec.show(schema.default);
  return <TypedField {...described} {...{ unit, codec, value, change, empty }} long={(schema.maxLength ?? 0) > 500} />;
}

type Unit = readonly [string | undefined, number];

const unitsIn = ({ unit, unit_of_prismatic }: Schema): Partial<Schema> =>
  Object.fromEntries(Object.entries({ unit, unit_of_prismatic }).filter(([, one]) => one !== undefined));

/** The unit in which a number of the API is typed, and its size. */
function useUnits(): (schema: Schema, slides?: boolean) => Unit {
  const page = STIFFNESS_UNITS[useSettings().unit];
  return ({ unit = "", unit_of_prismatic: other }, slides = false) =>
    unit === "N.m/rad" ? [page.label, 1 / page.factor] : (USUAL[(slides && other) || unit] ?? [undefined, 1]);
}

const WORDS: Record<string, string> = {
  ...text.methods,
  ...text.weightings,
  ...text.elasticities,
  ...text.losses,
  ...jointWords.kinds,
  ...jointWords.conventions,
  ...formWords.values,
};

/** A word for a value of the API. */
const wordOf = (value: string): string => WORDS[value] ?? value.replaceAll("_", " ");

/** What is typed for a value; a change from elsewhere, or of the unit, takes its place. */
function useTyped(codec: Codec, value: unknown, change: (value: unknown) => void) {
  const valueOf = (typed: string) => {
    const read = codec.read(typed);
    return read === undefined ? { unread: typed } : read;
  };
  const shown = isUnread(value) ? value.unread : codec.show(value);
  const [typed, set] = useState(shown);
  const [byHand, setByHand] = useState(false);
  // In the same frame: what is typed next must not meet a text that still changes.
  useLayoutEffect(() => {
    if (JSON.stringify(valueOf(typed)) === JSON.stringify(value ?? null)) return;
    set(shown);
    setByHand(false);
  }, [JSON.stringify(value), shown]);
  return {
    typed,
    unread: codec.read(typed) === undefined,
    /** Of numbers that someone typed: how they are understood, where that is not plain. */
    meant: (unit: string | undefined) => (byHand ? understood(codec, typed, unit) : undefined),
    type: (next: string) => {
      set(next);
      setByHand(true);
      change(valueOf(next));
    },
  };
}

/** What a number is understood as that may be read in two ways, with its unit; undefined of any other text. */
export function understood(codec: Codec, typed: string, unit: string | undefined): string | undefined {
  const value = codec === OF_TEXT || !isAmbiguous(typed) ? null : codec.read(typed);
  return value === null || value === undefined ? undefined : formWords.understood(codec.show(value), unit ?? "");
}

interface TypedFieldProps {
  codec: Codec;
  value: unknown;
  change: (value: unknown) => void;
  label: string;
  unit: string | undefined;
  path: string;
  help: string | undefined;
  /** What holds where nothing is typed. */
  empty: string;
  long: boolean;
}

function TypedField({ codec, value, change, empty, long, help, ...field }: TypedFieldProps) {
  const { typed, unread, meant, type } = useTyped(codec, value, change);
  return (
    <TextField
      {...field}
      help={unread ? formWords.unread(typed) : (meant(field.unit) ?? help)}
      value={typed}
      change={type}
      placeholder={empty}
      aria-invalid={unread}
      lines={long ? 4 : codec.lines ? 3 : codec.isList ? 1 : undefined}
    />
  );
}

interface Column {
  name: string;
  schema: Schema;
}

/** What is stated of each joint, or a list of objects that grows. */
function Grid({ schema, value, change, path, label, help }: Part & { label: string; help: string | undefined }) {
  const { all, terms } = useContext(Form);
  const unitOf = useUnits();
  const problem = useContext(FormProblem);
  const row = plain(schema.additionalProperties ?? schema.items ?? {}, all);
  const pair = row.prefixItems !== undefined;
  const columns = pair
    ? formWords.ends.map((name): Column => ({ name, schema: { type: "number", ...unitsIn(schema) } }))
    : Object.entries(row.properties ?? {}).map(([name, of]): Column => ({ name, schema: plain(of, all) }));
  const document = asFields(value);
  const list = Array.isArray(value) ? (value as unknown[]) : [];
  const keys = schema.items ? list.map((_, i) => String(i)) : (terms.joints ?? []);
  const at = (name: string): string | number => (pair ? formWords.ends.indexOf(name) : name);
  const put = (key: string, name: string, part: unknown) => {
    const before = asFields(document[key]);
    const next = pair
      ? formWords.ends.map((end, i) => (end === name ? part : (before[i] ?? null)))
      : { ...before, [name]: part };
    const { [key]: _, ...others } = document;
    if (schema.items) change(list.map((one, i) => (String(i) === key ? next : one)));
    else change(Object.values(next).every((one) => one === null) ? others : { ...others, [key]: next });
  };
  const place = (terms.within ?? "") + path;
  const faultsOf = (key: string) => faultsAt(problem, schema.items ? `${place}[${key}]` : `${place}.${key}`);
  const said = new Set(keys.flatMap(faultsOf));
  const slides = list.some((one) => asFields(one)["kind"] === "prismatic");
  const unitsOf = (of: Schema) => [...new Set([unitOf(of)[0], ...(slides ? [unitOf(of, true)[0]] : [])])].join(", ");
  const headOf = ({ name, schema: of }: Column) => [
    pair ? name : (terms.labels?.[`${path}.${name}`] ?? spoken(name)),
    unitsOf(of),
  ];
  return (
    <fieldset>
      <legend>{label}</legend>
      {help && <p class="soft">{help}</p>}
      <Scroll label={label}>
        <table class="inputs knowledge">
          <thead>
            <tr>
              <th scope="col">{text.run.joint}</th>
              {columns.map((column) => (
                <th scope="col">
                  {headOf(column)[0]} <small>{headOf(column)[1]}</small>
                </th>
              ))}
            </tr>
          </thead>
          <tbody>
            {keys.map((key) => (
              <tr>
                <th scope="row">
                  <bdi>{schema.items ? Number(key) + 1 : key}</bdi>
                  <Faults faults={faultsOf(key)} />
                </th>
                {columns.map((column) => (
                  <td>
                    <Cell
                      schema={column.schema}
                      label={
                        schema.items
                          ? jointWords.cell(headOf(column)[0] ?? "", Number(key) + 1)
                          : `${headOf(column)[0]}, ${key}`
                      }
                      factor={unitOf(column.schema, asFields(document[key])["kind"] === "prismatic")[1]}
                      value={asFields(document[key])[at(column.name)]}
                      change={(part) => put(key, column.name, part)}
                    />
                  </td>
                ))}
              </tr>
            ))}
          </tbody>
        </table>
      </Scroll>
      <Faults faults={faultsAt(problem, place).filter((fault) => !said.has(fault))} />
      {schema.items && (
        <div class="row">
          <Button onClick={() => change([...list, terms.seeds?.[path] ?? {}])}>{formWords.add}</Button>
          <Button disabled={keys.length < 2} onClick={() => change(list.slice(0, -1))}>
            {formWords.removeLast}
          </Button>
        </div>
      )}
    </fieldset>
  );
}

interface CellProps {
  schema: Schema;
  factor: number;
  label: string;
  value: unknown;
  change: (value: unknown) => void;
}

function Cell({ schema, factor, label, value, change }: CellProps) {
  const codec = codecOf(schema, {}, factor) ?? OF_TEXT;
  const { typed, unread, meant: meantIn, type } = useTyped(codec, value, change);
  const meant = meantIn(undefined);
  const set = (event: { currentTarget: { value: string } }) => type(event.currentTarget.value);
  if (!schema.enum)
    return (
      <>
        <input
          type="text"
          inputMode="decimal"
          autocomplete="off"
          aria-label={label}
          aria-invalid={unread}
          value={typed}
          onInput={set}
        />
        {meant && <small class="soft">{meant}</small>}
      </>
    );
  return (
    <select aria-label={label} value={typed} onChange={set}>
      {schema.enum.map((one) => (
        <option value={one} selected={one === typed}>
          {wordOf(one)}
        </option>
      ))}
    </select>
  );
}
