/// <reference types="node" />
import { existsSync, readdirSync, readFileSync, writeFileSync } from "node:fs";
import { brotliCompressSync, gzipSync } from "node:zlib";
import { defineConfig, type Plugin } from "vite";

// The page is served by the service itself, under a content security policy without inline code: no
// inlined assets, no module preload polyfill, which would be inline.
const SERVICE = "http://127.0.0.1:8000";

/** What most views share; forms, drops, and what only some views compute come with these views. */
const LATER = `box campaign choosers kinematics list map observation pull question schema_form`;
const LIBRARIES = `node_modules/(?:preact|@tanstack|openapi-fetch|idb-keyval)|vite/preload-helper`;
const SHARED = new RegExp(
  `src/(?:components|lib|state|api|words)/(?!(?:${LATER.split(/\s+/).join("|")})\\.ts)|src/features/(?:measure/readings|run/words)|src/charts/ramp|${LIBRARIES}`,
);
/** What the start needs beside that, and several other views. */
const START =
  /src\/(?:features\/(?:start\/view|readings\/(?:flow|begun|opening|imports|words)|runs\/view|measure\/(?:open_campaigns|words)|trend\/(?:changed|trend|words))|components\/schema_form|lib\/campaign)\.tsx?$/;

/** Pack each asset once, next to it, so that the service has nothing to compress. */
const packed: Plugin = {
  name: "packed-assets",
  apply: "build",
  closeBundle() {
    const folder = new URL("../service/static/assets/", import.meta.url);
    if (!existsSync(folder)) return; // the build has failed, and says why
    const names = readdirSync(folder);
    const worker = new URL("../worker.js", folder); // what a device keeps that measures without a network
    const list = `const ASSETS = ${JSON.stringify(names.map((name) => `assets/${name}`))}`;
    writeFileSync(
      worker,
      readFileSync(worker, "utf-8").replace("const ASSETS = []", () => list),
    );
    for (const name of names) {
      const content = readFileSync(new URL(name, folder));
      if (content.length <= 1024) continue;
      writeFileSync(new URL(`${name}.gz`, folder), gzipSync(content, { level: 9 }));
      writeFileSync(new URL(`${name}.br`, folder), brotliCompressSync(content)); // the greatest quality by default
    }
  },
};

export default defineConfig({
  base: "./",
  plugins: [packed],
  oxc: { jsx: { runtime: "automatic", importSource: "preact" } },
  build: {
    outDir: "../service/static",
    emptyOutDir: true,
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
    sourcemap: false,
    target: "es2022",
    // What most views share is one file: many small ones cost more, in headers and in what packing saves.
    rolldownOptions: {
      output: {
        codeSplitting: {
          groups: [
            { name: "shared", test: SHARED },
            { name: "start", test: START },
          ],
        },
      },
    },
  },
  // The Host header stays the page's own, as the service refuses changes that another origin asks for.
  server: { proxy: { "/v1": { target: SERVICE }, "/health": { target: SERVICE } } },
});
