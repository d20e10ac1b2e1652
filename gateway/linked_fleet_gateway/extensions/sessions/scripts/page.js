// Invitations: makes one, and shows its link, which the gateway tells once.

import { say } from "../../pages/scripts/src/say.js";
import { statements } from "../../pages/scripts/src/ntriples.js";
import { refresh } from "../../pages/scripts/src/region.js";
import { send } from "../../pages/scripts/src/request.js";
import { TITLE, lf } from "../../pages/scripts/src/vocabulary.js";

const DATE_TIME = "http://www.w3.org/2001/XMLSchema#dateTime";
const HOUR_MS = 3_600_000;

export function start() {
  document.addEventListener("submit", (event) => {
    const form = event.target;
    if (!(form instanceof HTMLFormElement) || !form.matches("form.invitation")) return;
    event.preventDefault();
    invite(form);
  });
  // Before, a click would send the form as one of HTML.
  const button = document.querySelector("form.invitation button[type=submit]");
  button?.removeAttribute("hidden");
}

async function invite(form) {
  const output = form.querySelector("output.answer");
  const { title, hours } = Object.fromEntries(new FormData(form));
  const until = new Date(Date.now() + Number(hours) * HOUR_MS - 1000).toISOString();
  const body = statements([
    [TITLE, { kind: "literal", value: String(title).trim() }],
    [lf("expires"), { kind: "literal", value: until, datatype: DATE_TIME }],
  ]);
  const { problem, graph, location } = await send("POST", document.body.dataset.resource, { body });
  const link = location && graph?.value(location, lf("invitationLink"))?.value;
  output.dataset.state = link ? "done" : "error";
  if (!link) {
    output.textContent = problem ? `${problem.title}. ${problem.detail}` : say("The answer has no link. Revoke the invitation, and make another one.");
    return;
  }
  const field = Object.assign(document.createElement("input"), { id: "invitation-link", readOnly: true, value: link });
  field.addEventListener("focus", () => field.select());
  const label = Object.assign(document.createElement("label"), { htmlFor: field.id, textContent: say("Send this link. It is shown only now:") });
  form.reset(); // it would empty the field as well
  output.replaceChildren(label, field);
  refresh();
}
