// Drives a base by hand over a stream of its action drive.

import { say } from "../../pages/scripts/src/say.js";
import { ByHand } from "./by_hand.js";
import { Stick } from "./stick.js";

const WORDS = { control: "stick", begin: say("Drive"), doing: say("You drive"), idle: say("You do not drive.") };

export function show(/** @type {HTMLElement} */ section) {
  new Drive(section);
}

class Drive {
  constructor(section) {
    this.section = section;
    this.control = new Stick(section.querySelector(".stick"), section);
    new ByHand(section, WORDS, this);
  }

  action() {
    return new URL(this.section.dataset.drive, document.baseURI);
  }

  moves() {
    return Object.values(this.control.value()).some(Boolean);
  }

  input(share, told) {
    const [wanted, most] = [this.control.value(), told.values.driveLimits ?? {}];
    const input = { linear: share * wanted.linear * (most.linear ?? 0), angular: share * wanted.angular * (most.angular ?? 0) };
    if (most.lateral) input.lateral = share * wanted.lateral * most.lateral;
    return input;
  }

  figures(told) {
    const { linear = 0, angular = 0 } = told.values.twist ?? {};
    return say("{linear} m/s, {angular} rad/s", { linear: linear.toFixed(2), angular: angular.toFixed(2) });
  }
}
