// Settings of the page by key: what they are now, where they began, and who is told.

import { changed, fragmentOf, settingsOf } from "#live/fragment";

export class Settings {
  constructor() {
    this.known = new Map(); // key -> { first, value, apply, listeners }
    this.listeners = [];
  }

  /** A setting: its first value (a number, text or truth value), what is done with another, and whether it is allowed. */
  define(key, first, apply = () => {}, allowed = () => true) {
    this.known.set(key, { first, value: first, apply, allowed, shows: [] });
  }

  /** Call `show` with the value of now and of later. */
  watch(key, show) {
    const setting = this.known.get(key);
    setting.shows.push(show);
    show(setting.value);
  }

  get(key) {
    return this.known.get(key).value;
  }

  /** Set a value; of the type of the first one, and allowed, or nothing happens.  Returns whether it was taken. */
  put(key, given) {
    const setting = this.known.get(key);
    if (!setting) return false;
    const value = likeFirst(setting.first, given);
    if (value === null || !setting.allowed(value)) return false;
    setting.value = value;
    setting.apply(value);
    setting.shows.forEach((show) => show(value));
    this.listeners.forEach((listener) => listener(key, value));
    return true;
  }

  /** All settings as they began. */
  restore() {
    for (const [key, { first, value }] of this.known) if (first !== value) this.put(key, first);
  }

  /** What differs from the beginning, as a fragment of an address. */
  fragment() {
    const all = (part) => new Map([...this.known].map(([key, setting]) => [key, setting[part]]));
    return fragmentOf(changed(all("value"), all("first")));
  }

  /** Take the settings of a fragment, in the order in which they were defined; returns keys that were not taken. */
  read(fragment) {
    const given = settingsOf(fragment);
    const refused = [...given.keys()].filter((key) => !this.known.has(key));
    for (const key of this.known.keys()) if (given.has(key) && !this.put(key, given.get(key))) refused.push(key);
    return refused;
  }
}

function likeFirst(first, given) {
  if (typeof first === "number") {
    const value = typeof given === "number" ? given : String(given).trim() === "" ? NaN : Number(given);
    return Number.isFinite(value) ? value : null;
  }
  if (typeof first === "boolean") {
    if (typeof given === "boolean") return given;
    return given === "true" ? true : given === "false" ? false : null;
  }
  return String(given);
}
