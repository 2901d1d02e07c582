/**
 * Keeps the page on this device, so that it can be loaded again without a network: its assets, which never change
 * under their names, and the frame of the page as it was served last. Answers of the API are never kept here.
 */
const KEPT = "jointstiff-page";

/** Addresses of the assets; the build writes them here. */
const ASSETS = [];

self.addEventListener("install", () => self.skipWaiting());
self.addEventListener("activate", (event) => event.waitUntil(self.clients.claim()));

/** A campaign beside a robot needs every view. */
self.addEventListener("message", (event) => event.waitUntil(keepAll()));

self.addEventListener("fetch", (event) => {
  const { request } = event;
  const { origin, pathname } = new URL(request.url);
  if (request.method !== "GET" || origin !== self.location.origin) return;
  const path = pathname.slice(new URL(self.registration.scope).pathname.length);
  if (path.startsWith("assets/")) event.respondWith(fromDevice(request));
  else if (path === "" && request.mode === "navigate") event.respondWith(fromService(request));
});

async function fromDevice(request) {
  const kept = await caches.open(KEPT);
  const found = await kept.match(request);
  if (found) return found;
  const answer = await fetch(request);
  if (answer.ok) await kept.put(request, answer.clone());
  return answer;
}

async function fromService(request) {
  const kept = await caches.open(KEPT);
  try {
    const answer = await fetch(request);
    if (answer.ok) await kept.put(request.url, answer.clone());
    return answer;
  } catch (error) {
    const found = await kept.match(request.url);
    if (found) return found;
    throw error;
  }
}

/** Keep all assets, and drop those of an older page. */
async function keepAll() {
  const kept = await caches.open(KEPT);
  const wanted = new Set(ASSETS.map((name) => new URL(name, self.registration.scope).href));
  for (const { url } of await kept.keys()) {
    const isAsset = url.startsWith(`${self.registration.scope}assets/`);
    if (isAsset && !wanted.has(url)) await kept.delete(url);
    wanted.delete(url);
  }
  await Promise.all([...wanted].map((url) => fromDevice(new Request(url)).catch(() => undefined)));
  if (!(await kept.match(self.registration.scope))) await kept.add(self.registration.scope);
}
