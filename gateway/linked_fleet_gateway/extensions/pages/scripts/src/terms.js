// Completions of editors: this project's terms with their comments, and the keywords of SPARQL.

import { parse } from "./ntriples.js";
import { lf, localName } from "./vocabulary.js";

const LABEL = "http://www.w3.org/2000/01/rdf-schema#label";
const COMMENT = "http://www.w3.org/2000/01/rdf-schema#comment";
const DECLARATIONS = { sparql: `PREFIX lf: <${lf("")}>\n`, turtle: `@prefix lf: <${lf("")}> .\n` };
const DECLARED = /(?:@prefix|PREFIX)\s+lf:/i;
const KEYWORDS = "SELECT,DISTINCT,WHERE,FILTER,OPTIONAL,UNION,MINUS,BIND,AS,VALUES,GRAPH,ASK,CONSTRUCT,DESCRIBE,PREFIX,NOT EXISTS,EXISTS,GROUP BY,HAVING,ORDER BY,DESC,LIMIT,OFFSET,COUNT,SUM,AVG,MIN,MAX,REGEX,STRENDS,STRSTARTS,CONTAINS,BOUND,COALESCE,ABS,ROUND"
  .split(",")
  .map((label) => ({ label, type: "keyword", boost: -1 }));

let terms;

/** @returns {(context: import("@codemirror/autocomplete").CompletionContext) => Promise<import("@codemirror/autocomplete").CompletionResult|null>} */
export function complete(language) {
  return async (context) => {
    const word = context.matchBefore(/[A-Za-z][\w-]*(?::[\w-]*)?$/);
    if (!word && !context.explicit) return null;
    const from = word?.from ?? context.pos;
    if (context.matchBefore(/[?$<"]\w*$/)) return null;
    const ours = (await (terms ??= fetchTerms())).map((each) => ({ ...each, apply: insert(each.label, language) }));
    return { from, options: [...ours, ...(language === "sparql" ? KEYWORDS : [])], validFor: /^[\w-]*:?[\w-]*$/ };
  };
}

async function fetchTerms() {
  const { root = "/" } = document.body.dataset;
  try {
    const response = await fetch(new URL("vocabulary", new URL(root, document.baseURI)), { headers: { Accept: "application/n-triples" } });
    if (!response.ok) throw new Error(response.statusText);
    const graph = parse(await response.text());
    const found = [...graph.subjects.keys()].filter((iri) => iri.startsWith(lf("")) && iri.length > lf("").length);
    return found.map((iri) => ({
      label: `lf:${localName(iri)}`,
      detail: spoken(graph.values(iri, LABEL)) ?? "",
      info: spoken(graph.values(iri, COMMENT)),
      type: /^[A-Z]/.test(localName(iri)) ? "class" : "property",
    }));
  } catch (error) {
    terms = undefined; // the next letter retries
    console.debug("the vocabulary could not be fetched:", error);
    return [];
  }
}

/** Return the text in the language of the page; else that in English, or without a language. */
function spoken(texts) {
  const inLanguage = (language) => texts.find((each) => each.language === language);
  return (inLanguage(document.documentElement.lang) ?? inLanguage("en") ?? inLanguage(undefined))?.value;
}

/** Insert a term, and declare its prefix if it is missing. */
function insert(label, language) {
  return (view, _, from, to) => {
    const changes = [{ from, to, insert: label }];
    const missing = DECLARED.test(view.state.doc.toString()) ? "" : DECLARATIONS[language];
    if (missing) changes.unshift({ from: 0, to: 0, insert: missing });
    view.dispatch({ changes, selection: { anchor: from + label.length + missing.length }, userEvent: "input.complete" });
  };
}
