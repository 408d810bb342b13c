// Elements of the panel: sliders with numbers, choices and switches, each bound to a setting.

import { parsed, shown, sliderScale } from "#live/numbers";

/** The element of the page with this id. */
export const by = (id) => document.getElementById(id);

/** An element with attributes and children; texts are texts, never markup. */
export function element(tag, attributes = {}, ...children) {
  const found = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) found.addEventListener(name.slice(2), value);
    else if (value !== null && value !== false) found.setAttribute(name, value === true ? "" : value);
  }
  found.append(...children);
  return found;
}

let count = 0;
const unique = () => `control${++count}`;

/** A slider with a number beside it.  range: low, high, log, zero, unit, about. */
export function slider(settings, key, label, range) {
  const id = unique(), scale = sliderScale(range), { unit = "", about = "" } = range;
  const bar = element("input", { type: "range", min: 0, max: 1, step: 0.001, id, "aria-label": label });
  const number = element("input", { type: "text", inputmode: "decimal", "aria-label": `${label}, ${unit || "a number"}` });
  bar.addEventListener("input", () => settings.put(key, Number(shown(scale.toValue(Number(bar.value)), 3))));
  bar.addEventListener("dblclick", () => settings.put(key, settings.known.get(key).first));
  number.addEventListener("change", () => {
    if (!settings.put(key, parsed(number.value))) number.value = shown(settings.get(key), 5);
  });
  settings.watch(key, (value) => {
    bar.value = scale.toPosition(value);
    bar.setAttribute("aria-valuetext", `${shown(value)} ${unit}`);
    number.value = shown(value, 5);
  });
  const name = element("label", { for: id, title: about || label }, label);
  return element("div", { class: "slider" }, name, number, element("span", { class: "unit" }, unit), bar);
}

/** A choice of one of several: [value, text] each. */
export function choice(settings, key, label, options) {
  const id = unique();
  const list = element("select", { id }, ...options.map(([value, text]) => element("option", { value }, text)));
  list.addEventListener("change", () => settings.put(key, list.value));
  settings.watch(key, (value) => { list.value = value; });
  return element("div", { class: "choice" }, element("label", { for: id }, label), list);
}

/** A switch. */
export function toggle(settings, key, label) {
  const id = unique(), box = element("input", { type: "checkbox", id });
  box.addEventListener("change", () => settings.put(key, box.checked));
  settings.watch(key, (value) => { box.checked = value; });
  return element("div", { class: "toggle" }, box, element("label", { for: id }, label));
}

/** A group that opens and closes. */
export function group(title, open, ...children) {
  return element("details", open ? { open: true } : {}, element("summary", {}, title), ...children);
}
