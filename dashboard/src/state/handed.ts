/** A file that one view hands to another, because it belongs there. */
let handed: File | null = null;

export function handOver(file: File): void {
  handed = file;
}

/** The file, once. */
export function takeHanded(): File | null {
  const file = handed;
  handed = null;
  return file;
}
