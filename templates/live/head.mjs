// What all pages have: settings in the address, a scene, light or dark, and a line for what there is to say.

import { by } from "#live/controls";
import { Scene } from "#live/scene";
import { Settings } from "#live/settings";

const DARK = "(prefers-color-scheme: dark)";

export class Shell {
  constructor(data) {
    this.data = data;
    this.settings = new Settings();
    this.scene = new Scene(by("view"), data);
    this.frame = this.frame.bind(this);
    window.addEventListener("hashchange", () => this.read());
    by("share").addEventListener("click", () => this.share());
  }

  /** Define the theme as a setting with its button; the scene has its colours, also where the system changes its own. */
  addTheme() {
    const root = document.documentElement;
    const isDark = () => (root.dataset.theme ? root.dataset.theme === "dark" : window.matchMedia(DARK).matches);
    const dress = () => this.scene.theme(isDark());
    this.settings.define("theme", "", (value) => {
      if (value) root.dataset.theme = value;
      else delete root.dataset.theme;
      dress();
    }, (value) => ["", "light", "dark"].includes(value));
    by("theme").addEventListener("click", () => this.settings.put("theme", isDark() ? "light" : "dark"));
    window.matchMedia(DARK).addEventListener("change", dress);
    dress();
  }

  /** Copy the address with what was set; where a page may not write to the clipboard, it is said. */
  async share() {
    const address = window.location.href.split("#")[0] + this.settings.fragment();
    try {
      await navigator.clipboard.writeText(address);
      by("share").textContent = "Copied";
    } catch {
      this.say(address);
    }
  }

  /** Take the settings of the address. */
  read() {
    this.refuse(this.settings.read(window.location.hash));
  }

  refuse(keys) {
    if (keys.length) this.say(`The address has settings that this page does not know: ${keys.join(", ")}`);
  }

  /** From now on it is drawn, frame by frame. */
  ready() {
    document.documentElement.dataset.ready = "yes";
    requestAnimationFrame(this.frame);
  }

  say(text) {
    by("message").textContent = text;
    by("message").hidden = !text;
  }
}
