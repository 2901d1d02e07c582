/** The page on this device: a service worker keeps its files, so that it can be loaded again without a network. */

/** Keep every view on this device. Browsers have service workers on secure pages only, and on this machine. */
export async function keepPage(): Promise<void> {
  const workers: ServiceWorkerContainer | undefined = navigator.serviceWorker;
  if (!workers) return;
  await workers.register("worker.js");
  (await workers.ready).active?.postMessage("keep");
}
