/** What is known of joints beforehand: bounds, priors, and which joint is at least as stiff as which. */
import { useContext } from "preact/hooks";
import { Faults, FormProblem, NumberBox } from "../components/fields";
import { Scroll } from "../components/table";
import { faultsAt } from "../lib/faults";
import type { Order, Two } from "../lib/run_options";
import { formUnit } from "../lib/units";
import { useSettings } from "../state/settings";
import { text } from "../i18n";
import type { SettingsProps } from "./advanced";
import { Button } from "../components/basics";

const words = text.settings;
const PATHS = { bounds: "stiffness_bounds", priors: "priors" } as const;

export function JointKnowledge({ options, change, joints }: SettingsProps) {
  const problem = useContext(FormProblem);
  const unit = formUnit(useSettings().unit).label;
  if (joints.length === 0)
    return (
      <fieldset>
        <legend>{words.knowledge}</legend>
        <p class="soft">{words.robotFirst}</p>
      </fieldset>
    );
  return (
    <>
      {(["bounds", "priors"] as const).map((name) => (
        <Pairs
          title={`${words[name]} [${unit}]`}
          help={words[`${name}Help`]}
          heads={words[`${name}Heads`]}
          joints={joints}
          values={options[name]}
          change={(values) => change({ [name]: values })}
          faultsOf={(joint) => faultsAt(problem, [PATHS[name], ...joint].join("."))}
        />
      ))}
      <Orders
        orders={options.orders}
        change={(orders) => change({ orders })}
        joints={joints}
        faults={faultsAt(problem, "stiffness_order")}
      />
    </>
  );
}

/** A row a joint with two numbers. Faults of a joint stand beneath its row, others of the field at its end. */
function Pairs({
  title,
  help,
  heads,
  joints,
  values,
  change,
  faultsOf,
}: {
  title: string;
  help: string;
  heads: string[];
  joints: string[];
  values: Record<string, Two>;
  change: (values: Record<string, Two>) => void;
  /** Of a joint, or of the whole field. */
  faultsOf: (joint: string[]) => string[];
}) {
  const said = new Set(joints.flatMap((joint) => faultsOf([joint])));
  const put = (joint: string, at: 0 | 1, typed: string) => {
    const two: Two = [...(values[joint] ?? ["", ""])];
    two[at] = typed;
    change({ ...values, [joint]: two });
  };
  return (
    <fieldset>
      <legend>{title}</legend>
      <p class="soft">{help}</p>
      <Scroll label={title}>
        <table class="inputs knowledge">
          <thead>
            <tr>
              <th scope="col">{text.run.joint}</th>
              {heads.map((head) => (
                <th scope="col">{head}</th>
              ))}
            </tr>
          </thead>
          <tbody>
            {joints.map((joint) => (
              <tr>
                <th scope="row">
                  <bdi>{joint}</bdi>
                  <Faults faults={faultsOf([joint])} />
                </th>
                {([0, 1] as const).map((at) => (
                  <td>
                    <NumberBox
                      aria-label={`${heads[at]}, ${joint}`}
                      aria-invalid={faultsOf([joint]).length > 0}
                      value={values[joint]?.[at] ?? ""}
                      change={(typed) => put(joint, at, typed)}
                    />
                  </td>
                ))}
              </tr>
            ))}
          </tbody>
        </table>
      </Scroll>
      <Faults faults={faultsOf([]).filter((fault) => !said.has(fault))} />
    </fieldset>
  );
}

function Orders({
  orders,
  change,
  joints,
  faults,
}: {
  orders: Order[];
  change: (orders: Order[]) => void;
  joints: string[];
  faults: string[];
}) {
  const put = (row: number, order: Order) => change(orders.map((old, i) => (i === row ? order : old)));
  return (
    <fieldset>
      <legend>{words.orders}</legend>
      <p class="soft">{words.ordersHelp}</p>
      {orders.map(([first, second], row) => (
        <div class="order">
          <JointSelect label={words.stiffer} joints={joints} value={first} change={(to) => put(row, [to, second])} />
          <span>{words.atLeast}</span>
          <JointSelect label={words.softer} joints={joints} value={second} change={(to) => put(row, [first, to])} />
          <Button
            look="quiet"
            onClick={() => change(orders.filter((_, i) => i !== row))}
            aria-label={words.removeOrder(first, second)}
          >
            {words.remove}
          </Button>
        </div>
      ))}
      <Faults faults={faults} />
      <Button onClick={() => change([...orders, ["", ""]])}>{words.addOrder}</Button>
    </fieldset>
  );
}

function JointSelect({
  label,
  joints,
  value,
  change,
}: {
  label: string;
  joints: string[];
  value: string;
  change: (joint: string) => void;
}) {
  return (
    <select aria-label={label} value={value} onChange={(event) => change(event.currentTarget.value)}>
      <option value="">{words.pickJoint}</option>
      {joints.map((joint) => (
        <option value={joint} selected={joint === value}>
          {joint}
        </option>
      ))}
    </select>
  );
}
