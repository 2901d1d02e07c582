/** The house of the page: features apart from what they share. Biome finds circles of imports (`noImportCycles`). */
import { readdirSync, readFileSync } from "node:fs";
import { dirname, join, normalize } from "node:path";
import { describe, expect, it } from "vitest";

const SOURCES = new URL("../src/", import.meta.url);
const MODULES = readdirSync(SOURCES, { recursive: true, encoding: "utf-8" }).filter((name) => /\.tsx?$/.test(name));
const contentOf = (module: string): string => readFileSync(new URL(module, SOURCES), "utf-8");

/** The module that a path of a module means; none for the types that are made from the description of the API. */
function meant(module: string, path: string): string | undefined {
  const place = normalize(join(dirname(module), path));
  return [place, `${place}.ts`, `${place}.tsx`, `${place}/index.ts`].find((name) => MODULES.includes(name));
}

/** Modules that a module imports when it is loaded, or for their types; not those that it loads later. */
function importedBy(module: string): string[] {
  const paths = [...contentOf(module).matchAll(/^(?:import|export) [^;]*?from "(\.[^"]+)"/gms)].map(([, path]) => path);
  return paths.map((path) => meant(module, path ?? "")).filter((name) => name !== undefined);
}

const IMPORTS = new Map(MODULES.map((module) => [module, importedBy(module)]));

describe("modules of the page", () => {
  it("are all found", () => {
    expect(MODULES.length).toBeGreaterThan(80);
    expect(IMPORTS.get("main.tsx")).toContain("app.tsx");
  });

  it("that features share import no feature", () => {
    const shared = MODULES.filter((module) => /^(?:api|charts|components|lib|scene|state|words)\//.test(module));
    const strays = shared.filter((module) => IMPORTS.get(module)?.some((name) => name.startsWith("features/")));
    expect(strays).toEqual([]);
  });

  it("have the words of a feature in its folder", () => {
    const folders = new Set(MODULES.map((module) => /^features\/(\w+)\//.exec(module)?.[1]).filter(Boolean));
    const wordy = [...folders].filter((folder) => MODULES.includes(`features/${folder}/words.ts`));
    expect(wordy.length).toBeGreaterThan(10);
  });
});

describe("a stiffness", () => {
  const CONVERTS = /\b(?:inUnit|maybeInUnit|intervalIn)\b/;

  it("is converted and written in one module, and printed by one component", () => {
    expect(MODULES.filter((module) => CONVERTS.test(contentOf(module)))).toEqual(["lib/stiffness.ts"]);
    const prints = MODULES.filter((module) => /class=\{?[^}\n]*"estimate\b/.test(contentOf(module)));
    expect(prints).toEqual(["components/estimate.tsx"]);
  });
});
