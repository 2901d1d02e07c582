/** Keys for posting safely: the same content gives the same key, so that a file dropped twice is stored once. */

/**
 * A 106-bit hash of a text. Not cryptographic, as `crypto.subtle` is absent on plain http; the service refuses
 * a key that comes again with another body, so that a collision is an error and never another robot.
 */
export function contentKey(kind: string, content: unknown): string {
  const text = JSON.stringify(content);
  return `${kind}-${half(text, 0x9e3779b9)}${half(text, 0x85ebca6b)}`;
}

function half(text: string, seed: number): string {
  let [a, b] = [0xdeadbeef ^ seed, 0x41c6ce57 ^ seed];
  for (let i = 0; i < text.length; i++) {
    const code = text.charCodeAt(i);
    a = Math.imul(a ^ code, 2654435761);
    b = Math.imul(b ^ code, 1597334677);
  }
  a = Math.imul(a ^ (a >>> 16), 2246822507) ^ Math.imul(b ^ (b >>> 13), 3266489909);
  b = Math.imul(b ^ (b >>> 16), 2246822507) ^ Math.imul(a ^ (a >>> 13), 3266489909);
  return (4294967296 * (2097151 & b) + (a >>> 0)).toString(36);
}

/** A key that no other post has. */
export function freshKey(kind: string): string {
  const numbers = crypto.getRandomValues(new Uint32Array(4));
  return `${kind}-${[...numbers].map((n) => n.toString(36)).join("")}`;
}
