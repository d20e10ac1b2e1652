// Bundles what pages need into ../assets, each file named by its content, and writes down the licences. The scripts of
// each extension are in its folder `scripts`: `page.js` exports `start`, and `style.css` is part of the stylesheet.

import { existsSync } from "node:fs";
import { mkdir, readdir, readFile, rm, writeFile } from "node:fs/promises";
import path from "node:path";
import { fileURLToPath } from "node:url";
import { brotliCompressSync, gzipSync } from "node:zlib";

import { build } from "esbuild";

const LEAST_BYTES = 1024; // shorter ones gain nothing
const here = path.dirname(fileURLToPath(import.meta.url));
const assets = path.join(here, "..", "assets");
const extensions = path.join(here, "..", "..");

const folders = (await readdir(extensions)).sort().map((each) => path.join(extensions, each, "scripts"));

/** Resolves the modules "extensions" and "extensions.css", which import the file of each extension that has one. */
const ofExtensions = {
  name: "extensions",
  setup({ onResolve, onLoad }) {
    const named = (file) => folders.map((each) => path.join(each, file)).filter(existsSync).map((each) => JSON.stringify(each));
    onResolve({ filter: /^extensions(\.css)?$/ }, (found) => ({ path: found.path, namespace: "extensions" }));
    onLoad({ filter: /^extensions$/, namespace: "extensions" }, () => {
      const files = named("page.js");
      const imports = files.map((file, index) => `import * as part${index} from ${file};`);
      const parts = `export const parts = [${files.map((_, index) => `part${index}`)}];`;
      return { contents: [...imports, parts].join("\n"), resolveDir: here };
    });
    onLoad({ filter: /[.]css$/, namespace: "extensions" }, () => {
      const imports = named("style.css").map((file) => `@import ${file};`);
      return { contents: imports.join("\n"), loader: "css", resolveDir: here };
    });
  },
};

// What scripts say, in each language other than English: a script of its own, which pages load before the others.
const SAID = /(?<![\w.$])(?:say|message)\(\s*("(?:[^"\\]|\\.)*")/g;
const MOST_OF_A_WORD = 40; // states and actions, which scripts say as they come
const translations = {};
const said = new Set();
for (const folder of folders) {
  const source = path.basename(path.dirname(folder)) === "pages" ? path.join(folder, "src") : folder;
  const files = existsSync(source) ? (await readdir(source)).filter((each) => each.endsWith(".js")) : [];
  for (const file of files) {
    for (const [, text] of (await readFile(path.join(source, file), "utf8")).matchAll(SAID)) said.add(JSON.parse(text));
  }
  const languages = path.join(folder, "..", "languages");
  for (const file of existsSync(languages) ? await readdir(languages) : []) {
    const read = JSON.parse(await readFile(path.join(languages, file), "utf8"));
    Object.assign((translations[path.basename(file, ".json")] ??= {}), read);
  }
}
// Labels of terms, which the vocabulary has in each language.
const LABELS = /rdfs:label "([^"]*)" , "([^"]*)"@(\w+)/g;
const shapes = path.join(extensions, "..", "..", "..", "shapes", "linked_fleet_shapes");
for (const file of [shapes, ...folders.map((each) => path.join(each, ".."))].map((each) => path.join(each, "vocabulary.ttl"))) {
  for (const [, english, text, language] of existsSync(file) ? (await readFile(file, "utf8")).matchAll(LABELS) : []) {
    const inside = /^[A-Z][a-z]/.test(english) ? english[0].toLowerCase() + english.slice(1) : english;
    (translations[language] ??= {})[inside] ??= text;
  }
}
const isSaid = (text) => said.has(text) || (text.length <= MOST_OF_A_WORD && /^[a-z][\w ]*$/.test(text));

/** Resolves "messages-de" to the script that has the German messages. */
const ofLanguages = {
  name: "languages",
  setup({ onResolve, onLoad }) {
    onResolve({ filter: /^messages-/ }, (found) => ({ path: found.path, namespace: "languages" }));
    onLoad({ filter: /./, namespace: "languages" }, (found) => {
      const all = Object.entries(translations[found.path.replace("messages-", "")]).filter(([text]) => isSaid(text));
      return { contents: `globalThis.linkedFleetMessages = ${JSON.stringify(Object.fromEntries(all.sort()))};` };
    });
  },
};

await rm(assets, { recursive: true, force: true });
await mkdir(assets, { recursive: true });

const result = await build({
  absWorkingDir: here,
  nodePaths: [path.join(here, "node_modules")],
  plugins: [ofExtensions, ofLanguages],
  entryPoints: {
    page: "src/page.js",
    style: "src/style.css",
    icon: "src/icon.svg",
    ...Object.fromEntries(Object.keys(translations).map((each) => [`messages-${each}`, `messages-${each}`])),
  },
  loader: { ".svg": "copy" },
  bundle: true,
  splitting: true,
  format: "esm",
  target: ["es2022"],
  minify: true,
  legalComments: "none",
  metafile: true,
  outdir: assets,
  entryNames: "[name]-[hash]",
  chunkNames: "[name]-[hash]",
  logLevel: "warning",
});

const manifest = {};
for (const [output, { entryPoint }] of Object.entries(result.metafile.outputs)) {
  if (entryPoint) manifest[path.basename(entryPoint).replace("languages:", "")] = path.basename(output);
}
await writeFile(path.join(assets, "manifest.json"), JSON.stringify(manifest, null, 1));

// All that is in the bundles, what the packages themselves need among it.
const bundled = Object.keys(result.metafile.inputs).map((each) => /node_modules\/((?:@[^/]+\/)?[^/]+)\/(?!.*node_modules)/.exec(each)?.[1]);
const notices = await Promise.all([...new Set(bundled.filter(Boolean))].sort().map(notice));
await writeFile(path.join(assets, "LICENSES.txt"), notices.join(`\n${"-".repeat(80)}\n\n`));

// Compressed once, as small as can be: these files never change.
for (const file of await readdir(assets)) {
  const content = await readFile(path.join(assets, file));
  if (file === "manifest.json" || content.length < LEAST_BYTES) continue;
  await writeFile(path.join(assets, `${file}.br`), brotliCompressSync(content));
  await writeFile(path.join(assets, `${file}.gz`), gzipSync(content, { level: 9 }));
}

async function notice(name) {
  const folder = path.join(here, "node_modules", name);
  const { version, license, homepage } = JSON.parse(await readFile(path.join(folder, "package.json"), "utf8"));
  const file = (await readdir(folder)).find((each) => /^licen[cs]e/i.test(each));
  const text = file ? await readFile(path.join(folder, file), "utf8") : "";
  return `${[`${name} ${version}`, license, homepage].filter(Boolean).join(", ")}\n\n${text.trim()}\n`;
}
