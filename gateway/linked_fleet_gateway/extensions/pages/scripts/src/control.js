// The token of a control lease held by this browser (gateway/linked_fleet_gateway/actions/PROTOCOL.md), kept across pages.

const PREFIX = "linked-fleet control of ";

/** Store the token of a control lease, or remove it with the lease. */
export function remember(method, iri, response) {
  const token = response.headers.get("lock-token");
  if (token) localStorage.setItem(PREFIX + iri, token);
  else if (method === "DELETE" && response.ok) localStorage.removeItem(PREFIX + iri);
}

/** Return the header fields for a request below a robot whose lease this browser holds. */
export function proof(iri) {
  for (let index = 0; index < localStorage.length; index++) {
    const name = localStorage.key(index);
    if (!name?.startsWith(PREFIX)) continue;
    const robot = new URL("./", name.slice(PREFIX.length)).href;
    const token = localStorage.getItem(name);
    if (iri.startsWith(robot) && token) return { "Lock-Token": token };
  }
  return {};
}

/** Store the token of a control lease that came by another way. */
export function keep(iri, token) {
  localStorage.setItem(PREFIX + iri, token);
}

/** Remove the token of the lease at this address: somebody else has control from now on. */
export function giveUp(iri) {
  localStorage.removeItem(PREFIX + iri);
}

/** Return whether this browser holds the lease at this address. */
export function holds(iri) {
  return localStorage.getItem(PREFIX + iri) !== null;
}
