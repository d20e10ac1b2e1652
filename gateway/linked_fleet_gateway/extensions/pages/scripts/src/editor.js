// Editors of SPARQL and Turtle that replace text areas, which keep the text for the forms.

import { autocompletion, closeBrackets, closeBracketsKeymap, completionKeymap } from "@codemirror/autocomplete";
import { defaultKeymap, history, historyKeymap } from "@codemirror/commands";
import { bracketMatching, HighlightStyle, indentOnInput, StreamLanguage, syntaxHighlighting } from "@codemirror/language";
import { sparql } from "@codemirror/legacy-modes/mode/sparql";
import { turtle } from "@codemirror/legacy-modes/mode/turtle";
import { setDiagnostics } from "@codemirror/lint";
import { EditorState, Prec } from "@codemirror/state";
import { drawSelection, EditorView, keymap, lineNumbers } from "@codemirror/view";
import { tags } from "@lezer/highlight";

import { complete } from "./terms.js";

const MODES = { sparql, turtle };
/** @type {WeakMap<HTMLTextAreaElement, EditorView>} */
const views = new WeakMap();

const LOOK = EditorView.theme({
  "&": { color: "var(--ink)", backgroundColor: "var(--sheet)", border: "1px solid var(--soft)", borderRadius: "0.45rem", fontSize: "0.9rem" },
  "&.cm-focused": { outline: "3px solid var(--accent)", outlineOffset: "2px" },
  ".cm-scroller": { fontFamily: "var(--mono)", lineHeight: "1.5", maxHeight: "60vh", overflow: "auto", borderRadius: "0.45rem" },
  ".cm-content": { caretColor: "var(--ink)", minHeight: "8rem" },
  ".cm-cursor": { borderLeftColor: "var(--ink)" },
  ".cm-gutters": { color: "var(--soft)", backgroundColor: "var(--paper)", borderRight: "1px solid var(--line)" },
  "&.cm-focused > .cm-scroller > .cm-selectionLayer .cm-selectionBackground, .cm-selectionBackground": { background: "var(--busy-wash)" },
  "&.cm-focused .cm-matchingBracket": { backgroundColor: "var(--accent-wash)" },
  ".cm-lintRange-error": { backgroundImage: "none", textDecoration: "underline wavy var(--bad) 2px", textUnderlineOffset: "0.2em" },
  ".cm-lintPoint-error:after": { borderBottomColor: "var(--bad)" },
  ".cm-tooltip": { color: "var(--ink)", backgroundColor: "var(--sheet)", border: "1px solid var(--soft)", maxWidth: "min(30rem, 90vw)" },
  ".cm-tooltip .cm-diagnostic": { borderLeftColor: "var(--bad)" },
  ".cm-tooltip.cm-tooltip-autocomplete > ul > li[aria-selected]": { background: "var(--accent)", color: "var(--accent-ink)" },
  ".cm-completionDetail": { color: "inherit", fontStyle: "normal" },
});

const COLOURS = HighlightStyle.define([
  { tag: tags.keyword, color: "var(--busy)", fontWeight: "600" },
  { tag: [tags.atom, tags.bool, tags.number], color: "var(--warn)" },
  { tag: [tags.string, tags.special(tags.string)], color: "var(--good)" },
  { tag: tags.comment, color: "var(--soft)", fontStyle: "italic" },
  { tag: [tags.variableName, tags.special(tags.variableName)], color: "var(--accent)" },
  { tag: [tags.meta, tags.definitionKeyword], color: "var(--soft)" },
]);

/** Replace a text area by an editor. */
export function edit(area) {
  if (views.has(area)) return;
  const host = document.createElement("div");
  host.className = "editor";
  // CodeMirror adopts its styles in a shadow root; in a document it writes a style element, which the policy refuses.
  const root = host.attachShadow({ mode: "open" });
  const label = area.getAttribute("aria-label") ?? area.labels?.[0]?.textContent.trim() ?? "Text";
  const send = () => {
    area.form?.requestSubmit(area.form.querySelector("button[data-try]") ?? undefined);
    return true;
  };
  const view = new EditorView({
    root,
    parent: root,
    state: EditorState.create({
      doc: area.value,
      extensions: [
        lineNumbers(),
        history(),
        drawSelection(),
        indentOnInput(),
        bracketMatching(),
        closeBrackets(),
        autocompletion({ override: [complete(area.dataset.editor)] }),
        Prec.highest(keymap.of([{ key: "Mod-Enter", run: send }])),
        // Tab leaves the editor, so that it can be used without a mouse.
        keymap.of([...closeBracketsKeymap, ...defaultKeymap, ...historyKeymap, ...completionKeymap]),
        StreamLanguage.define(MODES[area.dataset.editor]),
        syntaxHighlighting(COLOURS),
        EditorView.domEventHandlers({ beforeinput: replaceSelection }),
        EditorView.lineWrapping,
        EditorView.contentAttributes.of({ "aria-label": label }),
        EditorView.updateListener.of((update) => {
          if (!update.docChanged) return;
          area.value = update.state.doc.toString();
          area.dispatchEvent(new Event("input", { bubbles: true }));
        }),
        LOOK,
      ],
    }),
  });
  view.scrollDOM.tabIndex = 0; // a long text is scrolled by keyboard too (WCAG 2.1.1)
  views.set(area, view);
  area.hidden = true;
  area.after(host);
  let width = 0;
  new ResizeObserver(() => {
    if (host.offsetWidth !== width) measure(host, view);
    width = host.offsetWidth;
  }).observe(host);
  area.addEventListener("replaced", () => {
    show(area, view);
    measure(host, view);
  });
  area.addEventListener("marked", () => mark(area, view));
  mark(area, view);
}

/**
 * Left to itself, Chromium joins lines of which a part is replaced by spans with inline styles, which the policy refuses.
 * What is replaced is what the browser has selected: the state of the editor hears of a selection only later.
 *
 * @param {InputEvent} event
 * @param {EditorView} view
 */
function replaceSelection(event, view) {
  const root = /** @type {any} */ (view.root); // shadow roots have selections of their own in Chromium alone
  const selected = root.getSelection?.() ?? document.getSelection();
  if (event.inputType !== "insertText" || !event.data || view.composing || !view.contentDOM.contains(selected?.anchorNode)) return false;
  const ends = [view.posAtDOM(selected.anchorNode, selected.anchorOffset), view.posAtDOM(selected.focusNode, selected.focusOffset)];
  const [from, to] = [Math.min(...ends), Math.max(...ends)];
  if (from === to) return false;
  event.preventDefault();
  const insert = view.state.toText(event.data);
  view.dispatch({ changes: { from, to, insert }, selection: { anchor: from + insert.length }, userEvent: "input.type", scrollIntoView: true });
  return true;
}

/**
 * CodeMirror measures an editor in sight alone: the numbers of another would not be beside its lines, which are wrapped.
 * Within one frame it is laid out in sight, and back in its place before that is painted.
 */
function measure(host, view) {
  const place = document.createElement("div"); // keeps its place meanwhile
  place.style.height = `${host.offsetHeight}px`;
  host.before(place);
  Object.assign(host.style, { position: "fixed", insetBlockStart: "0", width: `${host.offsetWidth}px`, visibility: "hidden" });
  view.requestMeasure({ read: () => {}, write: () => (host.removeAttribute("style"), place.remove()) });
}

/** Update the editor after the text area's text was replaced. */
function show(area, view) {
  if (view.state.doc.toString() === area.value) return;
  view.dispatch({ changes: { from: 0, to: view.state.doc.length, insert: area.value }, selection: { anchor: 0 } });
}

/** Show the position of the gateway's error: `data-line` and `data-column` of the text area count from 1. */
function mark(area, view) {
  const { line, column, message = "Here it could not be read." } = area.dataset;
  const { doc } = view.state;
  /** @type {import("@codemirror/lint").Diagnostic[]} */
  const diagnostics = [];
  if (line) {
    const at = doc.line(Math.min(Math.max(Number(line), 1), doc.lines));
    const found = Math.min(at.from + Math.max(Number(column || 1) - 1, 0), at.to);
    const from = found - /\S*$/.exec(doc.sliceString(at.from, found))[0].length;
    const to = found + /^\S*/.exec(doc.sliceString(found, at.to))[0].length;
    diagnostics.push({ from, to, severity: "error", message });
    view.dispatch({ effects: EditorView.scrollIntoView(from) });
  }
  view.dispatch(setDiagnostics(view.state, diagnostics));
}
