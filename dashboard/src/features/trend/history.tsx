/** What people state of an arm's history: the campaign to compare with, and marks such as a crash or a repair. */
import { useState } from "preact/hooks";
import { api } from "../../api/calls";
import type { Robot, Trend } from "../../api/types";
import { Button, Form, Name, ProblemNote } from "../../components/basics";
import { Select, TextField } from "../../components/fields";
import { dayText } from "../../lib/format";
import { useAction } from "../../state/action";
import { whenTexts } from "./trend";
import { trendWords as words } from "./words";

/** Which campaign the later ones are compared with: the first, or one that is chosen, such as that after a repair. */
export function ReferenceChoice({ trend, robot }: { trend: Trend; robot: Robot }) {
  const { campaigns } = trend;
  const choose = useAction(async (chosen: string) => {
    const own = new Set(campaigns.map(({ measurement_set_id: set }) => set));
    const others = robot.reference_set_ids.filter((id) => !own.has(id));
    await api.robots.change(robot.id, { reference_set_ids: chosen ? [...others, chosen] : others });
  });
  if (campaigns.length < 2) return null;
  const when = whenTexts(campaigns.map(({ at }) => at));
  const options = campaigns.map(({ measurement_set_id: value, name }, i) => ({
    value,
    label: words.named(name, when[i] ?? ""),
  }));
  return (
    <>
      <div class="filters compact">
        <Select
          label={words.reference}
          value={trend.reference_set_id ?? ""}
          change={choose.run}
          options={[{ value: "", label: words.firstCampaign }, ...options.slice(1)]}
        />
      </div>
      {choose.problem && <ProblemNote problem={choose.problem} />}
    </>
  );
}

/** Today in the zone of the reader, as a field of a date has it. */
const today = (): string => new Date().toLocaleDateString("sv");

/** A day's noon: whatever the zone of a reader, it is the same day for most of them. */
const noonOf = (day: string): string => new Date(`${day}T12:00`).toISOString();

/** The marks of an arm, and a form to add one. */
export function Marks({ robot, serial }: { robot: Robot; serial: string | null }) {
  const [day, setDay] = useState(today);
  const [note, setNote] = useState("");
  const ready = note.trim() !== "" && day !== "";
  const add = useAction(async () => {
    if (!ready) return;
    const mark = { at: noonOf(day), note: note.trim(), serial_number: serial };
    await api.robots.change(robot.id, { add_mark: mark });
    setNote("");
  });
  const remove = useAction((gone: Robot["marks"][number]) => api.robots.change(robot.id, { remove_mark: gone }));
  const own = robot.marks.filter(({ serial_number: of }) => of === null || of === serial);
  return (
    <section class="marks" aria-label={words.marks}>
      <h3>{words.marks}</h3>
      {own.length === 0 ? (
        <p class="soft">{words.marksHint}</p>
      ) : (
        <ol>
          {own.map((mark) => (
            <li>
              <span>{dayText(mark.at)}</span> <Name>{mark.note}</Name>
              <Button look="quiet" acts onClick={() => remove.run(mark)} aria-label={words.removeMark(mark.note)}>
                ×
              </Button>
            </li>
          ))}
        </ol>
      )}
      {remove.problem && <ProblemNote problem={remove.problem} />}
      <Form action={add}>
        <TextField type="date" label={words.when} value={day} change={setDay} />
        <TextField label={words.what} value={note} change={setNote} maxLength={200} placeholder={words.whatExample} />
        <Button acts type="submit" disabled={!ready || add.busy}>
          {add.busy ? words.marking : words.mark}
        </Button>
      </Form>
    </section>
  );
}
