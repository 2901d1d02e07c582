/** What people note about a measurement set, as they type it and as the service keeps it. */
import { METADATA, type Metadata } from "../api/types";

/** Texts of a form; a blank one is nothing. */
export type Typed = Record<keyof Metadata, string>;

/** The texts of a form that shows what is noted. */
export function typedOf(noted: Partial<Metadata>): Typed {
  const texts = Object.fromEntries(METADATA.map((name) => [name, noted[name] ?? ""])) as Typed;
  return { ...texts, measured_at: noted.measured_at ? localTime(noted.measured_at) : "" };
}

/** What a form says; null where it says nothing. Null for the whole while its time is none. */
export function notedIn(typed: Typed): Metadata | null {
  const at = typed.measured_at === "" ? null : new Date(typed.measured_at);
  if (at !== null && Number.isNaN(at.getTime())) return null;
  const texts = Object.fromEntries(METADATA.map((name) => [name, typed[name].trim() || null]));
  return { ...texts, measured_at: at === null ? null : at.toISOString() } as Metadata;
}

/** A time as the browser's field for a date and a time takes it: of this device's zone, to the minute. */
function localTime(time: string): string {
  const at = new Date(time);
  const two = (value: number) => String(value).padStart(2, "0");
  const day = `${at.getFullYear()}-${two(at.getMonth() + 1)}-${two(at.getDate())}`;
  return `${day}T${two(at.getHours())}:${two(at.getMinutes())}`;
}

/** Whether a set was measured on or between the days. */
export function wasMeasured(
  { measured_at: at }: Partial<Metadata>,
  { from, to }: { from: string; to: string },
): boolean {
  if (from === "" && to === "") return true;
  if (!at) return false;
  const day = localTime(at).slice(0, 10);
  return (from === "" || day >= from) && (to === "" || day <= to);
}
