// Messages of scripts in the language of the page. Pages load the translations of a language other than English first, as
// a script of its own; without it, as while the gateway does not answer, messages are in English.

/** @type {Record<string, string>} */
const translations = /** @type {any} */ (globalThis).linkedFleetMessages ?? {};
const LANGUAGE = document.documentElement.lang;
const IS_MARKED = LANGUAGE === "en-XA"; // for tests: see languages.py

/**
 * Return a message in the language of the page, with `values` in the places of their names in braces.
 *
 * @param {string} message the English text, which is the key of its translation
 * @param {Record<string, unknown>} [values]
 */
export function say(message, values) {
  const said = IS_MARKED ? `⟦${message}⟧` : translations[message] || message;
  return values ? said.replace(/\{(\w+)\}/g, (found, name) => (name in values ? String(values[name]) : found)) : said;
}

/** Return a message as it is: this marks one that is translated where it is said. */
export function message(text) {
  return text;
}

/** Return a number as people write it in the language of the page. */
export function localized(text) {
  return LANGUAGE === "de" ? text.replace(".", ",") : text;
}
