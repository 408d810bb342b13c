// The buttons at the head of a page: light or dark, and the address with what was set.

const DARK = "(prefers-color-scheme: dark)";
const by = (id) => document.getElementById(id);

/** Define the theme as a setting with its button; the scene has its colours, also where the system changes its own. */
export function addTheme(settings, scene) {
  const root = document.documentElement;
  const isDark = () => (root.dataset.theme ? root.dataset.theme === "dark" : window.matchMedia(DARK).matches);
  const dress = () => scene.theme(isDark());
  settings.define("theme", "", (value) => {
    if (value) root.dataset.theme = value;
    else delete root.dataset.theme;
    dress();
  }, (value) => ["", "light", "dark"].includes(value));
  by("theme").addEventListener("click", () => settings.put("theme", isDark() ? "light" : "dark"));
  window.matchMedia(DARK).addEventListener("change", dress);
  dress();
}

/** Let the button copy the address with what was set; where a page may not write to the clipboard, `say` shows it. */
export function addShare(settings, say) {
  by("share").addEventListener("click", async () => {
    const address = window.location.href.split("#")[0] + settings.fragment();
    try {
      await navigator.clipboard.writeText(address);
      by("share").textContent = "Copied";
    } catch {
      say(address);
    }
  });
}
