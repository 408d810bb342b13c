// Settings in the fragment of the page's address: those that differ from where the page begins, as KEY=VALUE.

/** Settings of a fragment: texts by key; what is no such text is left out. */
export function settingsOf(fragment) {
  const found = new Map();
  for (const part of fragment.replace(/^#/, "").split("&")) {
    const sign = part.indexOf("=");
    if (sign < 1) continue;
    try {
      found.set(decodeURIComponent(part.slice(0, sign)), decodeURIComponent(part.slice(sign + 1)));
    } catch {
      continue; // a lone per cent sign
    }
  }
  return found;
}

/** The fragment of settings; empty where there are none. */
export function fragmentOf(settings) {
  const plain = (text) => encodeURIComponent(text).replace(/%2C/g, ",").replace(/%3A/g, ":");
  const parts = [...settings].map(([key, value]) => `${plain(key)}=${plain(String(value))}`);
  return parts.length ? `#${parts.join("&")}` : "";
}

/** Settings that differ from the first ones: both are values by key. */
export function changed(settings, first) {
  return new Map([...settings].filter(([key, value]) => String(value) !== String(first.get(key))));
}
