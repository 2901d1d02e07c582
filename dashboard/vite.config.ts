import { defineConfig } from "vite";

// The page is served by the service itself, under a content security policy without inline code: no
// inlined assets, no module preload polyfill, which would be inline.
const SERVICE = "http://127.0.0.1:8000";

export default defineConfig({
  base: "./",
  oxc: { jsx: { runtime: "automatic", importSource: "preact" } },
  build: {
    outDir: "../service/static",
    emptyOutDir: true,
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
    sourcemap: false,
    target: "es2022",
  },
  // The Host header stays the page's own, as the service refuses changes that another origin asks for.
  server: { proxy: { "/v1": { target: SERVICE }, "/health": { target: SERVICE } } },
});
