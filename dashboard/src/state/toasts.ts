/** Short messages at the edge of the page, some with something to do, such as undo. */
import { useEffect, useState } from "preact/hooks";

interface Toast {
  id: number;
  message: string;
  action?: { label: string; run: () => void };
}

let toasts: Toast[] = [];
let count = 0;
const followers = new Set<(toasts: Toast[]) => void>();

function tell(next: Toast[]): void {
  toasts = next;
  followers.forEach((hear) => hear(next));
}

/** Show a message; with something to do it stays longer. */
export function toast(message: string, action?: Toast["action"]): void {
  const id = ++count;
  tell([...toasts.slice(-2), action ? { id, message, action } : { id, message }]);
  setTimeout(() => dismiss(id), action ? 20_000 : 5_000);
}

/** Copy a text, and say so; where there is no clipboard, as on plain http, it is shown to be copied. */
export function copied(content: string, label: string, said: string): void {
  if (!navigator.clipboard) prompt(label, content);
  else void navigator.clipboard.writeText(content).then(() => toast(said));
}

export function dismiss(id: number): void {
  tell(toasts.filter((shown) => shown.id !== id));
}

export function useToasts(): Toast[] {
  const [shown, set] = useState(toasts);
  useEffect(() => {
    followers.add(set);
    return () => void followers.delete(set);
  }, []);
  return shown;
}
