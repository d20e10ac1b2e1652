// Robots as they were: a slider over a time, their poses and values at each instant, and what happened then.

import { Moments } from "./moments.js";
import { number } from "../../pages/scripts/src/format.js";
import { whenWanted } from "../../pages/scripts/src/lazy_scene.js";
import { parse } from "../../pages/scripts/src/ntriples.js";
import { say } from "../../pages/scripts/src/say.js";
import { lf } from "../../pages/scripts/src/vocabulary.js";

const STEPS = 1000;
const AHEAD_S = 20;
const DECIMALS = 5; // more are invisible
const [TURNS, SLIDES] = [["rad", "rad/s", "N m"], ["m", "m/s", "N"]];
const NOTHING = say("Nothing is known of this time: the robot was not heard, or the history does not reach so far.");

export function start(/** @type {HTMLElement} */ section) {
  Object.assign(section, { replay: new Replay(section) });
}

class Replay {
  constructor(section) {
    this.section = section;
    this.begin = Date.parse(section.dataset.begin) / 1000;
    this.end = Date.parse(section.dataset.end) / 1000;
    this.bar = section.querySelector(".replay-bar");
    this.slider = section.querySelector("input[type=range]");
    this.button = section.querySelector("[data-play]");
    this.speed = section.querySelector("select[name=speed]");
    this.output = section.querySelector("output");
    this.robots = [...section.querySelectorAll("article[data-robot]")].map((each) => new Then(each));
    delete this.bar.dataset.unready;
    this.slider.max = String(STEPS);
    this.slider.oninput = () => this.go(this.begin + (this.slider.valueAsNumber / STEPS) * (this.end - this.begin));
    this.button.onclick = () => (this.frame ? this.pause() : this.play());
    for (const each of section.querySelectorAll("button[data-step]")) each.onclick = () => this.go(this.time + Number(each.dataset.step));
    this.open();
  }

  /** A recording says itself how long it is. */
  async open() {
    const range = await this.robots[0]?.range();
    if (range) [this.begin, this.end] = range;
    const told = Date.parse(new URLSearchParams(location.hash.slice(1)).get("at") ?? "") / 1000;
    this.go(told >= this.begin && told <= this.end ? told : this.begin);
  }

  /** Show an instant, in seconds since 1970. */
  go(/** @type {number} */ time) {
    this.time = Math.min(Math.max(time, this.begin), this.end);
    this.slider.value = String(Math.round(((this.time - this.begin) / (this.end - this.begin)) * STEPS));
    const text = new Date(this.time * 1000).toISOString().replace("T", " ").slice(0, 21) + " UTC";
    this.output.textContent = text;
    this.slider.setAttribute("aria-valuetext", text);
    this.section.dataset.at = String(this.time);
    this.happening();
    for (const robot of this.robots) robot.show(this.time, this.frame !== undefined);
  }

  play() {
    if (this.time >= this.end) this.go(this.begin);
    this.button.textContent = say("Pause");
    let last = performance.now();
    const step = (now) => {
      this.frame = requestAnimationFrame(step);
      const next = this.time + ((now - last) / 1000) * Number(this.speed.value);
      last = now;
      this.go(next);
      if (this.time >= this.end) this.pause();
    };
    this.frame = requestAnimationFrame(step);
  }

  pause() {
    cancelAnimationFrame(this.frame);
    this.frame = undefined;
    this.button.textContent = say("Play");
    this.go(this.time);
  }

  /** List the activities of the page that went on at this time, and mark their rows. */
  happening() {
    const rows = [...document.querySelectorAll("tr[data-row][data-begin]")];
    const active = rows.filter(({ dataset }) => Number(dataset.begin) <= this.time && this.time <= Number(dataset.end));
    for (const row of rows) row.toggleAttribute("data-active", active.includes(row));
    const key = active.map((row) => rows.indexOf(row)).join();
    if (key === this.shown) return;
    this.shown = key;
    const items = active.map((row) => {
      const item = document.createElement("li");
      const [link, state] = [row.querySelector("th a"), row.querySelector(".state")];
      item.append(link.cloneNode(true), " ", state ? state.cloneNode(true) : "");
      return item;
    });
    this.section.querySelector(".replay-events").replaceChildren(...items);
  }
}

/** One robot at an instant. */
class Then {
  constructor(article) {
    this.article = article;
    this.scene = article.querySelector(".scene");
    this.says = article.querySelector(".replay-says");
    this.tells = article.querySelector(".replay-around");
    this.table = article.querySelector(".scroll");
    this.values = article.querySelector(".replay-values");
    this.ready = this.find();
    this.ready.catch((error) => this.say(say("It cannot be shown: {message}", { message: error.message })));
  }

  /** Find the model and the history of the robot by its links. */
  async find() {
    const { robot, frames } = this.article.dataset;
    const answer = await fetch(robot, { headers: { Accept: "application/n-triples" } });
    if (!answer.ok) throw new Error(`${answer.status} ${answer.statusText}`);
    const graph = parse(await answer.text());
    const [model, history] = ["model", "history"].map((name) => graph.value(robot, lf(name))?.value);
    if (!frames && !history) throw new Error(say("no history of it is kept"));
    this.moments = new Moments(frames ?? history, Boolean(frames));
    if (!model) return;
    this.scene.dataset.model = model;
    this.scene.dataset.robot = robot;
    whenWanted(this.scene, async () => {
      const { show } = await import("../../pages/scripts/src/scene.js");
      show(this.scene);
      this.scene.scene.past(this.shown);
      if (!history) return;
      const { Surroundings } = await import("./surroundings.js");
      this.around = new Surroundings(robot, history, this.scene.scene);
      this.scene.addEventListener("drawn", () => this.show(this.time, false), { once: true });
    });
  }

  /** @returns {Promise<[number, number]|undefined>} the times at which a recording begins and ends */
  async range() {
    if (!this.article.dataset.frames) return undefined;
    try {
      await this.ready;
      return await this.moments.range();
    } catch (error) {
      this.say(say("It cannot be shown: {message}", { message: error.message }));
      return undefined;
    }
  }

  /** Show an instant; of several that are asked for while one is fetched, the last. */
  async show(time, playing) {
    this.time = time;
    this.wanted = { time, playing };
    if (this.busy) return;
    this.busy = true;
    try {
      await this.ready;
      while (this.wanted) {
        const { time: next, playing: goesOn } = this.wanted;
        this.wanted = undefined;
        const [then, values, around] = await Promise.all([this.moments.at(next), this.moments.valuesAt(next), this.surroundings(next)]);
        this.draw(next, then, values);
        this.told(then ? around() : "");
        if (goesOn && !this.moments.isWhole) this.moments.part(next + AHEAD_S).catch(() => {});
      }
    } catch (error) {
      this.say(say("It cannot be shown: {message}", { message: error.message }));
    } finally {
      this.busy = false;
    }
  }

  /** Return a function that draws what stood around it at a time, and says what is not drawn. */
  async surroundings(time) {
    if (this.scene.dataset.phase !== "ready" || !this.around) return () => "";
    return this.around.at(time).catch((error) => () => say("What stood around it cannot be shown: {message}", { message: error.message }));
  }

  told(text) {
    if (this.around) this.around.visible &&= Boolean(text);
    if (this.tells.textContent !== text) this.tells.textContent = text;
  }

  draw(time, then, values) {
    this.shown = then;
    this.scene.scene?.past(then);
    this.say(then ? "" : NOTHING);
    this.table.hidden = !then;
    this.article.toggleAttribute("data-nothing", !then);
    this.article.dataset.at = String(time);
    if (then) {
      const rows = then.names.map((name, index) => {
        const values = [then.positions, then.velocities, then.efforts].map((each) => each[index]);
        return row(name, values, then.slides[index] ? SLIDES : TURNS);
      });
      this.table.querySelector("tbody").replaceChildren(...rows);
    }
    const shown = then ? [...values].sort(([a], [b]) => a.localeCompare(b)) : [];
    this.values.replaceChildren(...shown.map(([path, value]) => fact(path, value)));
  }

  say(text) {
    if (this.says.textContent !== text) this.says.textContent = text;
  }
}

function row(name, values, units) {
  const line = document.createElement("tr");
  const head = Object.assign(document.createElement("th"), { textContent: name, scope: "row" });
  const text = (value, unit) => (Number.isFinite(value) ? `${number(Number(value.toFixed(DECIMALS)))} ${unit}` : say("unknown"));
  line.append(head, ...values.map((value, index) => Object.assign(document.createElement("td"), { textContent: text(value, units[index]) })));
  return line;
}

function fact(path, value) {
  const [group, name, said] = ["div", "dt", "dd"].map((each) => document.createElement(each));
  name.textContent = path;
  said.textContent = value;
  group.append(name, said);
  return group;
}
