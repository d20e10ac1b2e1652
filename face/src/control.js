// The proof that this browser has control of a robot (gateway/linked_fleet_gateway/actions/PROTOCOL.md): whoever took it goes on having it.

const PREFIX = "linked-fleet control of ";

/** Keep what a control lease came with; forget it with the lease. */
export function remember(method, iri, response) {
  const token = response.headers.get("lock-token");
  if (token) localStorage.setItem(PREFIX + iri, token);
  else if (method === "DELETE" && response.ok) localStorage.removeItem(PREFIX + iri);
}

/** Header fields for a request to what is below the same robot as a lease that is held here. */
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

/** Whether this browser has taken the lease at this address and not given it back. */
export function holds(iri) {
  return localStorage.getItem(PREFIX + iri) !== null;
}
